"""One channel is sampled earlier or later than the others."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from sim_backend.mechanisms.kinds import ChannelDistortion, Quantity, Real, Values
from sim_backend.mechanisms.places import channels_that_differ

NAME = "delay_of_b_samples"
TAPS = 24  # samples that an interpolation goes through
AT_END = 11  # and near an end, where more of them, from one side, would swing
OUTSIDE = 4  # samples that are extrapolated from beyond an end, by one sample at the most


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """Delay the channel by a part of a sample: Lagrange's interpolation through 24 samples, fewer at an end.

    A tone at 0.2, 0.25 and 0.3 of the rate is off by 6e-7, 5e-5 and 2e-3 of itself at the most; more in the last
    samples, of a lead in the first ones, which have neighbours on one side.
    """
    count, delay = rows.shape[1], values[NAME] / values.get("thinned", 1.0)
    at = np.arange(count) - delay
    first = np.floor(at).astype(int) - TAPS // 2 + 1
    inner = slice(*np.searchsorted(first, [0, max(count - TAPS + 1, 0)]))
    out = np.empty(rows.shape)
    if inner.stop > inner.start:
        weights = _weights(float(at[inner.start] - first[inner.start]), TAPS)
        used = rows[:, first[inner.start] : first[inner.stop - 1] + TAPS]
        out[:, inner] = [np.convolve(row, weights[::-1], mode="valid") for row in used]
    for k in (*range(inner.start), *range(inner.stop, count)):
        beyond = at[k] < 0 or at[k] > count - 1
        taps = min(OUTSIDE if beyond else AT_END, count)
        begin = min(max(round(at[k]) - taps // 2, 0), count - taps)
        out[:, k] = rows[:, begin : begin + taps] @ _weights(float(min(max(at[k], -1), count) - begin), taps)
    return out


@lru_cache(maxsize=4096)  # one delay serves for all segments, and for all but one of their slopes
def _weights(at: float, taps: int) -> Real:
    """Return (taps,) Lagrange's weights of samples 0, 1, ... for the value in between; not to be written to."""
    every = range(taps)
    weights = np.array([math.prod((at - k) / (j - k) for k in every if k != j) for j in every])
    weights.flags.writeable = False
    return weights


def _statement(values: Values, name: str) -> str:
    lag, name = values[NAME], f"{name[:1].upper()}{name[1:]}"
    if lag < 0:
        return f"{name} is {-lag:.3g} samples ahead of the rest: it is sampled that much later."
    return f"{name} lags {lag:.3g} samples behind the rest: it is sampled that much earlier, or held up on its way."


MECHANISM = ChannelDistortion(
    id="channel_skew",
    component="sensor chain",
    summary="one channel is sampled earlier or later than the others",
    source="multiplexed converter",
    parameters=(
        Quantity(NAME, "samples", -5.0, 5.0, "lag of the channel (of the tester B behind A); below zero it is ahead"),
    ),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-2}],
    distort=distort,
    at=channels_that_differ,
    one_signed=False,
    statement=_statement,
)
