"""A sensor whose gain changes with what it shows."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, Real, Values

SQUARE, CUBE = "squared_share", "cubed_share"


def distort(y: Real, values: Values, sample_rate_hz: float) -> Real:
    """y (1 + a y / peak + b (y / peak)^2)."""
    u = y / values["peak"]
    out: Real = y * (1.0 + values[SQUARE] * u + values[CUBE] * u * u)
    return out


def shown(what: str) -> dict[str, Quantity]:
    """Return the parameters of a curved scale, by name."""
    return {
        SQUARE: Quantity(SQUARE, "1", -0.9, 0.9, f"relative change of the {what}'s gain at its peak, odd part"),
        CUBE: Quantity(CUBE, "1", -0.9, 0.9, f"relative change of the {what}'s gain at its peak, even part"),
    }


MECHANISM = Mechanism(
    id="sensor_curvature",
    component="sensor chain",
    summary="a sensor whose gain changes with what it shows",
    source="static nonlinearity behind the rig (Wiener)",
    parameters=tuple(shown("sensor").values()),
    strength=CUBE,
    trials=lambda scale: [{SQUARE: 0.0, CUBE: 1e-3}],
    distort=distort,
    one_signed=False,
    statement=lambda values: (
        f"The gain of {{element}} is not constant: at its peak it is off by {100 * values[CUBE]:+.2g} % either way and "
        f"by {100 * values[SQUARE]:+.2g} % towards one side."
    ),
)
