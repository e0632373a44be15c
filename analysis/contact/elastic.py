"""Composite elasticity of two bodies (Sec. 2.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def composite_modulus(E_1: float, nu_1: float, E_2: float, nu_2: float) -> float:
    """Return E* in Pa: 1 / E* = (1 - nu_1^2) / E_1 + (1 - nu_2^2) / E_2, with E in Pa."""
    return 1 / ((1 - nu_1**2) / E_1 + (1 - nu_2**2) / E_2)


def combined_radius(R: Sequence[float]) -> float:
    """Equivalent radius, 1 / R = sum 1 / R_i, of the bodies' radii, m; infinite for a flat."""
    return 1 / sum(1 / r for r in R)


def combined_roughness(R_q: Sequence[float]) -> float:
    """Rms roughness of the gap between independent rough surfaces, root of the sum of squares, m."""
    return float(np.sqrt(np.sum(np.square(R_q))))


def plane_strain_block_stiffness(E_star: float, nu: float, d_th: float, a: float) -> float:
    """Stiffness of a smooth block on a rigid half space (Eq. 4), N/m per metre of contact length, Pa.

    Eq. 4 is the compression of a body by a line load: P is a force per length and the contact a strip of half-width a.
    The printed equation has E* where the plane-strain result has Young's modulus; it is kept as printed, since with it
    the published 58.9 GN/m is reproduced.

    Parameters
    ----------
    E_star
        Composite modulus, Pa.
    nu
        Poisson's ratio.
    d_th, a
        Thickness of the block and half-width of the contact, m.
    """
    return float(np.pi * E_star / ((1 - nu**2) * (2 * np.log(2 * d_th / a) - nu / (1 - nu))))
