"""Rough flats with exponentially distributed asperity heights (Sec. 2.2.2, Eq. 7, 8)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
C = 17.0  # Polycarpou and Etsion 1999: phi = C exp(-LAMBDA z / R_q) stands for the upper tail of a Gaussian
LAMBDA = 3.0


def load(d: ArrayLike, eta: float, A_n: float, E_star: float, R_s: float, R_q: float) -> FloatArray:
    """Contact load, N, at the separation ``d``, m, of the mean planes (Eq. 7), shaped like ``d``.

    Parameters
    ----------
    d
        (...) separation, m.
    eta
        Asperities per area, 1/m2.
    A_n
        Nominal area, m2.
    E_star
        Composite modulus, Pa.
    R_s, R_q
        Asperity radius and rms roughness, m.
    """
    amplitude = _amplitude(eta, A_n, E_star, R_s, R_q)
    return np.asarray(amplitude * np.exp(-LAMBDA * np.asarray(d, dtype=np.float64) / R_q), dtype=np.float64)


def stiffness(P: ArrayLike, R_q: float) -> FloatArray:
    """Contact stiffness, N/m, under the load ``P``, N (Eq. 8): lambda P / R_q.

    Printed with R_a; the derivative of Eq. 7 has R_q.
    """
    return np.asarray(LAMBDA * np.asarray(P, dtype=np.float64) / R_q, dtype=np.float64)


def separation(P: ArrayLike, eta: float, A_n: float, E_star: float, R_s: float, R_q: float) -> FloatArray:
    """Separation d, m, under the load ``P``, N, shaped like it; infinite without load. Arguments as `load`."""
    with np.errstate(divide="ignore"):
        return R_q / LAMBDA * np.log(_amplitude(eta, A_n, E_star, R_s, R_q) / np.asarray(P, dtype=np.float64))


def contact_area(P: ArrayLike, eta: float, A_n: float, E_star: float, R_s: float, R_q: float) -> FloatArray:
    """Area in which asperities touch, m2, under the load ``P``, N, shaped like it; proportional to it.

    pi R_s times the interference of each asperity: C pi eta A_n R_s R_q exp(-lambda d / R_q) / lambda^2.
    """
    mean_pressure = E_star / math.sqrt(math.pi * LAMBDA) * math.sqrt(R_q / R_s)
    return np.asarray(P, dtype=np.float64) / mean_pressure


def _amplitude(eta: float, A_n: float, E_star: float, R_s: float, R_q: float) -> float:
    """Load at d = 0, N."""
    beta = eta * R_s * R_q
    return C * math.sqrt(math.pi) * beta * E_star * A_n / LAMBDA**2.5 * math.sqrt(R_q / R_s)
