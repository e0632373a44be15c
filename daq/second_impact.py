"""Detect a second impact (double hit) in a record without a model of the tester: the record predicts itself.

Between impacts a linear tester rings freely, so every stretch of the record lies in the low-dimensional space that its
few decaying modes span. An impact leaves that space, and the component of the first one outside it is the pattern by
which a second is looked for: the inner product of the pattern with any later stretch is zero for free ringing, and at a
second impact it is the ratio of the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

BEFORE_S, AFTER_S = 0.6e-3, 2.4e-3
"""A stretch: its length before the supposed impact and after it, s."""

FREE_AFTER_S = 0.8e-3
"""The ringing counts as free from here on; a hand-held tap pushes for 0.1 to 0.6 ms."""

SEARCH_AFTER_S = 1.0e-3
"""A second impact sooner than this after the first is part of the first."""

MODES_FIRST, MODES_FINAL = 6, 10
"""Most dimensions of the space of free ringing: three modes with a candidate in it, five once it is taken out."""

NOISE_EDGE = 3.0
"""A dimension counts as ringing if its energy exceeds that of the largest pattern of pure noise by this factor."""


@dataclass(frozen=True, slots=True)
class SecondImpact:
    """The most likely second impact.

    Attributes
    ----------
    ratio
        Its strength relative to the first one, from 0; NaN where the record is too short to tell.
    delay_s
        Time after the trigger, s.
    noise_ratio
        Standard deviation that noise alone gives ``ratio``.
    """

    ratio: float
    delay_s: float
    noise_ratio: float


UNKNOWN = SecondImpact(math.nan, math.nan, math.nan)


def find_second_impact(acceleration_mean: NDArray[np.float64], sample_rate_hz: float, pretrigger: int) -> SecondImpact:
    """Return the most likely second impact after the one at sample ``pretrigger``, however weak.

    Parameters
    ----------
    acceleration_mean
        (n,) mean of A and B, m/s2.
    """
    before, after = round(BEFORE_S * sample_rate_hz), round(AFTER_S * sample_rate_hz)
    length = before + after
    first = pretrigger - 1  # the trigger sample is past the threshold: the impact began before it
    if before < 2 or first < before or pretrigger < 2 or acceleration_mean.size - pretrigger < 4 * length:
        return UNKNOWN
    y = acceleration_mean - acceleration_mean[:pretrigger].mean()
    noise = float(y[:pretrigger].std())
    stretches = sliding_window_view(y, length)
    impact = np.arange(len(stretches)) + before
    free = np.arange(len(stretches)) >= pretrigger + round(FREE_AFTER_S * sample_rate_hz)
    searched = impact >= first + round(SEARCH_AFTER_S * sample_rate_hz)
    used = free
    best, ratio, size = 0, np.zeros(len(stretches)), 0.0
    for most in (MODES_FIRST, MODES_FINAL):
        ringing = _ringing(stretches[used], noise, most)
        pattern = stretches[first - before] - ringing @ (ringing.T @ stretches[first - before])
        size = float(pattern @ pattern)
        if not size > 0:
            return UNKNOWN
        ratio = np.abs(stretches @ pattern) / size
        best = int(np.argmax(np.where(searched, ratio, 0.0)))
        # stretches across the candidate would add the shape of an impact to the space of free ringing
        used = free & ((impact <= best + before - after) | (impact >= best + 2 * before))
        if np.count_nonzero(used) < length:
            used = free
    return SecondImpact(float(ratio[best]), (int(impact[best]) - first) / sample_rate_hz, noise / math.sqrt(size))


def _ringing(stretches: NDArray[np.float64], noise: float, most: int) -> NDArray[np.float64]:
    """Return the orthonormal patterns (length, r) of which the stretches (m, length) consist, r at most ``most``."""
    energy, patterns = np.linalg.eigh(stretches.T @ stretches)
    edge = NOISE_EDGE * (noise * (math.sqrt(len(stretches)) + math.sqrt(stretches.shape[1]))) ** 2
    edge = max(edge, 1e-12 * float(energy[-1]))
    kept = min(most, max(4, int(np.count_nonzero(energy > edge))))
    return np.ascontiguousarray(patterns[:, ::-1][:, :kept])
