"""The dynamic contact force behind a recorded acceleration, by Eq. 9b alone: no model of the contact is needed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

HIGHPASS_FRACTION = 0.1
"""Corner of the zero-phase high-pass over sqrt(k2 / m2) / 2 pi, about the system mode."""


def taper_samples(samples: int, sample_rate_hz: float, m2_kg: float, k2_n_per_m: float) -> int:
    """Return how many samples at the end of a record `contact_force` fades out."""
    corner = HIGHPASS_FRACTION * math.sqrt(k2_n_per_m / m2_kg) / (2 * math.pi)
    return min(samples // 4, round(2 * sample_rate_hz / corner))


def contact_force(
    acceleration_mean: NDArray[np.float64],
    sample_rate_hz: float,
    m2_kg: float,
    k2_n_per_m: float,
    pretrigger: int = 0,
) -> NDArray[np.float64]:
    """Return the dynamic contact force ``m2 a2 + k2 x2`` of Eq. 9b, N, positive where the contact is pressed.

    The displacement is integrated in the frequency domain, ``x2 = -a2 / omega^2``, and everything below about a
    tenth of the system mode is taken out without a shift of phase: k2 x2 and m2 a2 nearly cancel in the system mode,
    so that a shift of 9 degrees would already pass for a force as large as a real one. Close to the onset this costs
    up to 4 % of the largest force.

    Parameters
    ----------
    acceleration_mean
        (n,) mean of A and B, m/s2.
    pretrigger
        Number of samples at rest at the beginning, whose mean is the zero; 0: the mean of the whole record is.

    Returns
    -------
    force
        (n,) N. Faded out over the last `taper_samples`, where the ringing was cut off.

    Raises
    ------
    ValueError
        The acceleration is not one list of samples, or a constant is not positive.
    """
    a = np.asarray(acceleration_mean, dtype=np.float64)
    if a.ndim != 1 or a.size < 2:
        raise ValueError(f"contact_force needs one list of samples, not an array of shape {a.shape}")
    if not min(sample_rate_hz, m2_kg, k2_n_per_m) > 0:
        raise ValueError("contact_force needs a positive sampling rate, mass and stiffness")
    fade = taper_samples(a.size, sample_rate_hz, m2_kg, k2_n_per_m)
    window = np.ones(a.size)
    if fade:
        window[-fade:] = 0.5 * (1 + np.cos(np.pi * (np.arange(fade) + 0.5) / fade))
    a = (a - (a[:pretrigger] if pretrigger else a).mean()) * window
    padded = 1 << (2 * a.size - 1).bit_length()
    omega = 2 * np.pi * np.fft.rfftfreq(padded, 1 / sample_rate_hz)
    corner = HIGHPASS_FRACTION * math.sqrt(k2_n_per_m / m2_kg)
    dynamic = omega**2 * (m2_kg * omega**2 - k2_n_per_m) / (omega**4 + corner**4)
    force: NDArray[np.float64] = np.fft.irfft(np.fft.rfft(a, padded) * dynamic, padded)[: a.size]
    return force
