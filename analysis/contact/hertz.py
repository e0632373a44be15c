"""Sphere on flat: Hertz (Sec. 2.1, Eq. 1 to 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def approach(P: ArrayLike, R: float, E_star: float) -> FloatArray:
    """Normal approach Delta, m, of a smooth sphere and a flat (Eq. 1), shaped like the load ``P``, N; R, m; E*, Pa."""
    return np.asarray(np.cbrt(9 * np.square(P) / (16 * R * E_star**2)), dtype=np.float64)


def load(Delta: ArrayLike, R: float, E_star: float) -> FloatArray:
    """Load P, N, of smooth surfaces at the approach ``Delta``, m (Eq. 1), shaped like it; zero where they are apart."""
    return np.asarray(4 / 3 * E_star * np.sqrt(R) * np.maximum(Delta, 0.0) ** 1.5, dtype=np.float64)


def stiffness(P: ArrayLike, R: float, E_star: float) -> FloatArray:
    """Contact stiffness dP / dDelta, N/m, of smooth surfaces (Eq. 2), shaped like the load ``P``, N.

    Examples
    --------
    >>> f"{float(stiffness(1.0, R=0.01, E_star=1e11)):.4g}"
    '8.434e+06'
    """
    return np.asarray(1.5 * np.cbrt(16 * R * E_star**2 / 9 * np.asarray(P, dtype=np.float64)), dtype=np.float64)


def rough_stiffness(P: ArrayLike, R: float, E_star: float) -> FloatArray:
    """Contact stiffness, N/m, of rough surfaces at light load (Eq. 3): a third of Eq. 2.

    The low-load end of Greenwood and Tripp's solution; at higher loads the stiffness lies between this and Eq. 2.
    """
    return stiffness(P, R, E_star) / 3


def contact_area(P: ArrayLike, R: float, E_star: float) -> FloatArray:
    """Area of contact pi a^2, m2, a^2 = R Delta, of smooth surfaces, shaped like the load ``P``, N."""
    return np.pi * R * approach(P, R, E_star)
