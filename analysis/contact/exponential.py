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
    beta = eta * R_s * R_q
    amplitude = C * math.sqrt(math.pi) * beta * E_star * A_n / LAMBDA**2.5 * math.sqrt(R_q / R_s)
    return np.asarray(amplitude * np.exp(-LAMBDA * np.asarray(d, dtype=np.float64) / R_q), dtype=np.float64)


def stiffness(P: ArrayLike, R_q: float) -> FloatArray:
    """Contact stiffness, N/m, under the load ``P``, N (Eq. 8): lambda P / R_q.

    Printed with R_a; the derivative of Eq. 7 has R_q.
    """
    return np.asarray(LAMBDA * np.asarray(P, dtype=np.float64) / R_q, dtype=np.float64)
