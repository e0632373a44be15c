"""One accelerometer's sensitivity is off."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ChannelDistortion, Derived, Quantity, Real, Values
from sim_backend.mechanisms.places import channels_that_differ

NAME = "gain_error_of_b"


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """Multiply the channel."""
    out: Real = rows * (1.0 + values[NAME])
    return out


MECHANISM = ChannelDistortion(
    id="channel_gain",
    component="sensor chain",
    summary="one accelerometer's sensitivity is off",
    source="sensitivity of a channel",
    parameters=(Quantity(NAME, "1", -0.9, 9.0, "relative error of B's sensitivity against A's"),),
    derived=(Derived("gain_of_b", "1", lambda values: 1 + values[NAME], meaning="B's sensitivity over A's"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-3}],
    distort=distort,
    at=channels_that_differ,
    one_signed=False,
    statement=lambda values, name: (
        f"{name[:1].upper()}{name[1:]} reads {100 * values[NAME]:+.2g} % against the rest: one sensor's sensitivity is "
        "off."
    ),
)
