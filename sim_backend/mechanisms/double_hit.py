"""The hammer comes down a second time."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity

NAME = "second_impulse_fraction"

MECHANISM = Mechanism(
    id="double_hit",
    component="impactor",
    summary="a second, smaller blow",
    source="rebounding impactor",
    parameters=(Quantity(NAME, "1", 0.0, 1.0, "impulse of the second blow over that of the first"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 0.0}],
    blow=True,
    statement=lambda values: (
        f"The impactor strikes twice: a second blow of {100 * values[NAME]:.2g} % of the first follows."
    ),
)
