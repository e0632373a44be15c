"""Deflection of an elastic half space under an axisymmetric pressure (Boussinesq).

With the pressure p over the unit disc, in units in which w(rho) = 2/pi int p(s) s / (s + rho) K ds (K the complete
elliptic integral of the first kind of modulus 2 (rho s)^(1/2) / (rho + s)), Copson's form of the kernel splits it
into two integrals without a singularity:

    q(x) = int_x^1 s p(s) (s^2 - x^2)^(-1/2) ds,    w(rho) = 2/pi int_0^(pi/2) q(rho sin theta) dtheta.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy import special

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class UnitDisc:
    """Nodes over the unit disc and the matrix from pressures to deflections at them.

    Attributes
    ----------
    square
        (n,) squares of the nodes' radii, Gauss-Legendre points of 0 to 1.
    weight
        (n,) weights: ``weight @ f`` is the integral of f over rho d(rho).
    deflection
        (n, n): ``deflection @ p`` is w at the nodes, exact for polynomials in rho^2 below the degree n.
    """

    square: FloatArray
    weight: FloatArray
    deflection: FloatArray


@functools.cache
def unit_disc(n: int) -> UnitDisc:
    """Return the disc with ``n`` nodes."""
    square, weight = _gauss(n)
    degree = np.arange(n)
    basis = legvander(2 * square - 1, n - 1)
    to_coefficients = (basis * weight[:, None]).T * (2 * degree[:, None] + 1)
    # q(x) = (1 - x^2)^(1/2) int_0^1 p(x^2 + (1 - x^2) e^2) de, whose second factor is a polynomial in x^2
    e, of_e = _gauss(n + 1)
    within = square[:, None] + (1 - square[:, None]) * e**2
    q = to_coefficients @ np.einsum("ijn,j->in", legvander(2 * within - 1, n - 1), of_e)
    theta, of_theta = _gauss(4 * n)
    x2 = square[:, None] * np.sin(math.pi / 2 * theta) ** 2
    outer = np.einsum("ijn,ij->in", legvander(2 * x2 - 1, n - 1), np.sqrt(1 - x2) * of_theta)
    return UnitDisc(square, weight / 2, outer @ q @ to_coefficients)


def _gauss(n: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre points and weights of 0 to 1."""
    x, w = special.roots_legendre(n)
    return (1 + x) / 2, w / 2
