"""A sensor whose gain changes with what it shows."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ChannelDistortion, Quantity, Real, Values
from sim_backend.mechanisms.places import each_channel

SQUARE, CUBE = "squared_share", "cubed_share"


def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
    """y (1 + a y / peak + b (y / peak)^2)."""
    u = rows / values["peak"]
    out: Real = rows * (1.0 + values[SQUARE] * u + values[CUBE] * u * u)
    return out


def curvature(what: str) -> tuple[Quantity, Quantity]:
    """Return the parameters of a curved scale of a sensor or an exciter."""
    return (
        Quantity(SQUARE, "1", -0.9, 0.9, f"relative change of the {what}'s gain at its peak, odd part"),
        Quantity(CUBE, "1", -0.9, 0.9, f"relative change of the {what}'s gain at its peak, even part"),
    )


def trials(scale: object) -> list[dict[str, float]]:
    """Return one set of values: a curvature is relative to the peak already."""
    return [{SQUARE: 0.0, CUBE: 1e-3}]


def statement(values: Values, name: str) -> str:
    """Say how far the gain is off."""
    return (
        f"The gain of {name} is not constant: at its peak it is off by {100 * values[CUBE]:+.2g} % either way and "
        f"by {100 * values[SQUARE]:+.2g} % towards one side."
    )


MECHANISM = ChannelDistortion(
    id="sensor_curvature",
    component="sensor chain",
    summary="a sensor whose gain changes with what it shows",
    source="static nonlinearity behind the rig (Wiener)",
    parameters=curvature("sensor"),
    strength=CUBE,
    trials=trials,
    distort=distort,
    at=each_channel,
    one_signed=False,
    statement=statement,
)
