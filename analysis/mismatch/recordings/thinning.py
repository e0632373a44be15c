"""Recordings thinned out: fewer samples of a free decay, through a filter that leaves white noise white.

What begins at once is spread by that filter over some samples before and after it. What a first impact spoils is not
fitted; what a second one shows is spread as the recording's is (`spread_impact`).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy import signal

from sim_backend.arrays import Real

RINGING: Final = 12  # samples, after thinning out, that the filter spoils on either side of what begins or ends at once
SPOILT: Final = 8  # of these, beyond which that is less than 1e-4 of a jump
PER_PERIOD: Final = 10  # samples kept of the highest frequency
FULL_BAND_ENERGY: Final = 0.999999  # of what stands out of a recording's noise, below its highest frequency
NOISE_LINES: Final = 6.0  # times the noise's power, that a line of noise hardly reaches
PASSED: Final = 0.2  # of the rate after thinning out, up to which its filter changes nothing


def thinning_factor(rows: Real, rate: float, band: tuple[float, float] | None, fewest: int) -> int:
    """Return by what rows (c, n) may be thinned out such that they show what they did in ``fewest`` samples."""
    if band is not None:
        highest = band[1]
    else:
        power = np.abs(np.fft.rfft((rows - rows.mean(axis=1, keepdims=True)) * np.hanning(rows.shape[1]))) ** 2
        # what is left in the upper half is noise, mean over median of a chi-squared of two degrees of freedom
        floor = np.median(power[:, power.shape[1] // 2 :], axis=1, keepdims=True) / math.log(2)
        grown = np.cumsum(np.maximum(power - NOISE_LINES * floor, 0.0), axis=1)
        place = max(int(np.searchsorted(row, FULL_BAND_ENERGY * row[-1])) for row in grown)
        highest = max(place, 1) * rate / rows.shape[1]
    return max(min(int(rate / (PER_PERIOD * highest)), rows.shape[1] // fewest), 1)


def thinned(rows: Real, factor: int) -> Real:
    """Return every so many samples of rows (c, n), after a filter of no phase that leaves white noise white.

    The power that it takes away below half the new rate is the one that it lets through as far above (the transition
    of Meyer's wavelets).

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal((1, 40_000))
    >>> bool(abs(np.std(thinned(noise, 4)) - 0.5) < 0.01)
    True
    """
    return smoothed(rows, factor)[:, ::factor]


def smoothed(rows: Real, factor: int) -> Real:
    """Return rows (c, n) through the filter that `thinned` takes samples of."""
    return np.asarray(signal.oaconvolve(rows, kernel(factor)[None], "same", axes=1), np.float64)


def kernel(factor: int) -> Real:
    """Return (2 ``RINGING`` factor + 1,) the filter's weights of the samples around one that is kept."""
    taps = 2 * RINGING * factor + 1
    frequency = np.fft.rfftfreq(16 * taps) * factor
    x = np.clip((frequency - PASSED) / (1 - 2 * PASSED), 0.0, 1.0)
    passed = np.cos(np.pi / 2 * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3))
    weights = np.roll(np.fft.irfft(passed, 16 * taps), RINGING * factor)[:taps]
    return np.asarray(weights / weights.sum(), np.float64)
