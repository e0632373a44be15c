"""The hammer comes down a second time."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import Quantity, SecondImpact

NAME = "second_impulse_fraction"

MECHANISM = SecondImpact(
    id="double_hit",
    component="impactor",
    summary="a second, smaller impact",
    source="rebounding impactor",
    parameters=(Quantity(NAME, "1", 0.0, 1.0, "impulse of the second impact over that of the first"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 0.0}],
    statement=lambda values, name: (
        f"The impactor strikes twice: a second impact follows, {100 * values[NAME]:.2g} % as large as the first."
    ),
)
