"""Sphere on flat: Hertz (Sec. 2.1, Eq. 1 to 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def approach(P: ArrayLike, R: float, E_star: float) -> FloatArray:
    """Normal approach Delta, m, of a smooth sphere and a flat (Eq. 1), shaped like the load ``P``, N; R, m; E*, Pa."""
    return np.asarray(np.cbrt(9 * np.square(P) / (16 * R * E_star**2)), dtype=np.float64)


def stiffness(P: ArrayLike, R: float, E_star: float) -> FloatArray:
    """Contact stiffness dP / dDelta, N/m, of smooth surfaces (Eq. 2), shaped like the load ``P``, N."""
    return np.asarray(1.5 * np.cbrt(16 * R * E_star**2 / 9 * np.asarray(P, dtype=np.float64)), dtype=np.float64)


def rough_stiffness(P: ArrayLike, R: float, E_star: float) -> FloatArray:
    """Contact stiffness, N/m, of rough surfaces at light load (Eq. 3): a third of Eq. 2.

    The low-load end of Greenwood and Tripp's solution; at higher loads the stiffness lies between this and Eq. 2.
    """
    return stiffness(P, R, E_star) / 3
