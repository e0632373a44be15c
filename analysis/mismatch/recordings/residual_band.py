"""When and at which frequencies most of a residual lies."""

from __future__ import annotations

import numpy as np

from analysis.mismatch.recordings.fit import SimulatedFit
from sim_backend.arrays import Real

MOST_ENERGY = 0.9  # of a residual, by which it is located


def residual_band(fitted: SimulatedFit) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return times (s) and frequencies (Hz) between which most of the residual of the first recording lies."""
    recorded = fitted.problem.recordings[0]
    off, at = fitted.off(0)
    t = recorded.start_s + np.arange(at.start, at.stop) / recorded.rate_hz
    spectrum = np.sum(np.abs(np.fft.rfft(off * np.hanning(off.shape[1]), axis=1)) ** 2, axis=0)
    lines = np.asarray(np.fft.rfftfreq(off.shape[1], 1 / recorded.rate_hz), np.float64)
    return _middle(np.sum(off**2, axis=0), t), _middle(spectrum, lines)


def _middle(energy: Real, at: Real) -> tuple[float, float]:
    """Return between which places most of the energy lies."""
    grown = np.cumsum(energy) / max(float(np.sum(energy)), 1e-300)
    edge = (1 - MOST_ENERGY) / 2
    low, high = np.searchsorted(grown, [edge, 1 - edge])
    return float(at[low]), float(at[min(high, at.size - 1)])
