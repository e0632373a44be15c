"""What vibration of finite amplitude makes of a contact's stiffness: harmonic balance about the preload.

Near the preload P a contact whose stiffness grows as the load^e carries P (1 + (1 - e) x / L)^(1 / (1 - e)) at the
approach x, L = P / k_c, and nothing where that is not a number: e = 1/3 is Hertz, e towards 1 the exponential law. With
x = x_0 + X cos(omega t) and the mean force kept at P by what is slow around the contact, the first harmonic F of the
force gives the stiffness that the resonance shows, F / X.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import interpolate

FloatArray = NDArray[np.float64]
LARGEST_RATIO = 1.9  # of F over P; a force that never pulls, of mean P, has a first harmonic below 2 P
_EXPONENTS = np.linspace(0.0, 0.98, 12)
_RATIOS = np.linspace(0.0, LARGEST_RATIO, 77)
_PHASE = (np.arange(64) + 0.5) * np.pi / 64
_BISECTIONS = 60


def apparent_share(exponent: ArrayLike, force_ratio: ArrayLike) -> FloatArray:
    """Return F / X over k_c at P.

    Parameters
    ----------
    exponent
        (...) e = d log k_c / d log P; what lies outside 0 to 0.98 is taken as the nearer end.
    force_ratio
        (...) F / P; above 1.9, as 1.9.

    Examples
    --------
    >>> round(float(apparent_share(1 / 3, 0.01)), 4)  # a small force sees the tangent stiffness
    1.0
    """
    e = np.clip(np.asarray(exponent, dtype=np.float64), 0.0, _EXPONENTS[-1])
    ratio = np.clip(np.asarray(force_ratio, dtype=np.float64), 0.0, LARGEST_RATIO)
    x, y = np.broadcast_arrays(e, ratio)
    return np.asarray(_table().ev(x, y), dtype=np.float64)


@functools.cache
def _table() -> interpolate.RectBivariateSpline:
    reach = np.geomspace(1e-3, 400.0, 300)  # X / L
    rows = []
    for e in _EXPONENTS:
        ratio = _first_harmonic(float(e), reach)
        rows.append(np.interp(_RATIOS, np.concatenate([[0.0], ratio]), np.concatenate([[1.0], ratio / reach])))
    return interpolate.RectBivariateSpline(_EXPONENTS, _RATIOS, np.array(rows), kx=3, ky=3)


def _first_harmonic(e: float, reach: FloatArray) -> FloatArray:
    """F / P for each X / L, (m,)."""
    wave = reach[:, None] * np.cos(_PHASE)

    def force(x0: FloatArray) -> FloatArray:
        return np.asarray(np.maximum(1 + (1 - e) * (x0[:, None] + wave), 0.0) ** (1 / (1 - e)), dtype=np.float64)

    low, high = -reach - 1 / (1 - e), np.zeros_like(reach)  # the law is convex: the mean deflection is below zero
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        above = force(middle).mean(axis=1) > 1
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 2 * np.asarray((force(high) * np.cos(_PHASE)).mean(axis=1))
