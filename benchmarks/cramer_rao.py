"""Cramer-Rao bounds of a free decay from its own parameters, by an explicit design matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


def bounds(poles: NDArray[np.complex128], amplitudes: NDArray[np.complex128], samples: int, sigma: float) -> Real:
    """Smallest standard errors of log decrement and phase of each pole.

    Parameters
    ----------
    poles, amplitudes
        (J,) sampled poles, and complex amplitudes at the first sample: the record is ``2 Re sum a z^k``.
    samples, sigma
        Length, and standard deviation of the white noise.

    Returns
    -------
    (J, 2, 2) covariance of real and imaginary part of ``log z``.
    """
    k = np.arange(samples)
    columns = []
    for z, a in zip(poles, amplitudes, strict=True):
        wave = a * z**k
        columns += [2 * (k * wave).real, -2 * (k * wave).imag, 2 * (z**k).real, -2 * (z**k).imag]
    design = np.stack(columns, axis=1)
    scale = np.linalg.norm(design, axis=0)
    covariance = sigma**2 * np.linalg.inv((design / scale).T @ (design / scale)) / np.outer(scale, scale)
    return np.stack([covariance[4 * j : 4 * j + 2, 4 * j : 4 * j + 2] for j in range(len(poles))])


def frequency_and_damping(log_pole: complex, covariance: Real, rate_hz: float) -> Real:
    """Bounds on frequency, Hz, and damping ratio from those of ``log z``: first-order."""
    size, a, b = abs(log_pole), log_pole.real, log_pole.imag
    gradient = np.array([[a / size * rate_hz / (2 * np.pi), b / size * rate_hz / (2 * np.pi)]])
    gradient = np.vstack([gradient, [-b * b / size**3, a * b / size**3]])
    return np.sqrt(np.diagonal(gradient @ covariance @ gradient.T))
