"""One channel is sampled later than the others."""

from __future__ import annotations

import numpy as np

from sim_backend.mechanisms.kinds import ChannelDistortion, Quantity, Real, Values
from sim_backend.mechanisms.places import last_of_alike

NAME = "delay_of_b_samples"
TAPS = np.arange(-5, 6)


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """Delay the channel by a part of a sample: Lagrange's interpolation through eleven samples."""
    delay = values[NAME]
    whole = round(delay)
    at = -(delay - whole)
    weights = np.array([np.prod([(at - k) / (j - k) for k in TAPS if k != j]) for j in TAPS])
    reach, count = abs(whole) + TAPS.size // 2, rows.shape[1] + TAPS.size - 1
    padded = np.pad(rows, ((0, 0), (reach, reach)), mode="edge")[:, abs(whole) - whole :][:, :count]
    return np.array([np.convolve(row, weights[::-1], mode="valid") for row in padded])


MECHANISM = ChannelDistortion(
    id="channel_skew",
    component="sensor chain",
    summary="one channel is sampled later than the others",
    source="multiplexed converter",
    parameters=(Quantity(NAME, "samples", -5.0, 5.0, "delay of B after A"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-2}],
    distort=distort,
    at=last_of_alike,
    one_signed=False,
    statement=lambda values, name: (
        f"{name[:1].upper()}{name[1:]} is sampled {values[NAME]:.3g} samples later than the others."
    ),
)
