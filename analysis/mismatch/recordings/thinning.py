"""Recordings thinned out: fewer samples of a free decay, through a filter that leaves white noise white.

What begins at once is spread by that filter over some samples before and after it. What a first impact spoils is not
fitted; what a second one shows is spread as the recording's is (`spread_impact`).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import signal

from sim_backend.arrays import Real

RINGING: Final = 12  # samples, after thinning out, that the filter spoils on either side of what begins or ends at once
SPOILT: Final = 8  # of these, beyond which that is less than 1e-4 of a jump
PASSED: Final = 0.2  # of the rate after thinning out, up to which its filter changes nothing


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
    return np.asarray(signal.oaconvolve(rows, kernel(factor)[None], "same", axes=1)[:, ::factor], np.float64)


def kernel(factor: int) -> Real:
    """Return (2 ``RINGING`` factor + 1,) the filter's weights of the samples around one that is kept."""
    taps = 2 * RINGING * factor + 1
    frequency = np.fft.rfftfreq(16 * taps) * factor
    x = np.clip((frequency - PASSED) / (1 - 2 * PASSED), 0.0, 1.0)
    passed = np.cos(np.pi / 2 * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3))
    weights = np.roll(np.fft.irfft(passed, 16 * taps), RINGING * factor)[:taps]
    return np.asarray(weights / weights.sum(), np.float64)
