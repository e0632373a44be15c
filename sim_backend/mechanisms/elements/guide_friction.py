"""Dry friction: a force of one size against the motion."""

from __future__ import annotations

from sim_backend.mechanisms.guide_friction import ROUNDING, force_law
from sim_backend.mechanisms.mechanism import Mechanism, Quantity

NAME = "friction_force_n"

MECHANISM = Mechanism(
    id="guide_friction",
    component="upper mass",
    summary="dry friction",
    source="Coulomb",
    parameters=(Quantity(NAME, "N", 0.0, 1e25, "friction force"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 0.001 * scale.force, "rounding": scale.rate / ROUNDING}],
    law=force_law,
    constants=lambda values, rest: (values[NAME], values["rounding"]),
    fits=("guide", "pendulum", "damper", "spring", "joint", "contact"),
    statement=lambda values: (
        f"The {{element}} rubs: a dry friction of {values[NAME]:.4g} works against the motion, whatever its speed."
    ),
)
