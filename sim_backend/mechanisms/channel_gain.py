"""One accelerometer's sensitivity is off."""

from __future__ import annotations

import numpy as np

from sim_backend.mechanisms.mechanism import Derived, Mechanism, Quantity, Real, Values

NAME = "gain_error_of_b"


def distort(y: Real, values: Values, sample_rate_hz: float) -> Real:
    """Multiply the last channel."""
    factors = np.ones((len(y), 1))
    factors[-1] += values[NAME]
    out: Real = y * factors
    return out


MECHANISM = Mechanism(
    id="channel_gain",
    component="sensor chain",
    summary="one accelerometer's sensitivity is off",
    source="sensitivity of a channel",
    parameters=(Quantity(NAME, "1", -0.9, 9.0, "relative error of B's sensitivity against A's"),),
    derived=(Derived("gain_of_b", "1", lambda values: 1 + values[NAME]),),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-3}],
    distort=distort,
    one_signed=False,
    statement=lambda values: (
        f"Channel B reads {100 * values[NAME]:+.2g} % against channel A: one accelerometer's sensitivity is off."
    ),
)
