"""Somebody or something knocks at a rig that is driven."""

from __future__ import annotations

import math

from sim_backend.mechanisms.kinds import Quantity, SecondImpact

NAME = "knock_impulse_n_s"

MECHANISM = SecondImpact(
    id="knock",
    component="surroundings",
    summary="an impact on the rig that none of its inputs shows",
    source="a bench that is bumped, a cable that is plucked, a part that drops",
    parameters=(Quantity(NAME, "N s", 0.0, math.inf, "impulse of the largest impact"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 0.0}],
    driven=True,
    statement=lambda values, name: (
        f"Something knocked at the rig that none of its inputs shows, with an impulse of {values[NAME]:.3g} N s."
    ),
)
