"""Dry friction: a force of one size against the motion, as between the upper mass and the frame."""

from __future__ import annotations

import math

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

NAME, ROUNDING = "friction_force_n", "rounding"
ROUNDINGS = (1e8, 500.0, 50.0)  # the sign of the speed is rounded below such a share of the speed after an impact


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """F sign(v), p[4] = F; p[5] a speed far below those of the motion, within which it changes sign."""
    return force + p[4] * math.tanh(v / p[5])


MECHANISM = ForceLaw(
    id="guide_friction",
    component="upper mass",
    summary="dry friction",
    source="Coulomb",
    parameters=(Quantity(NAME, "N", 0.0, 1e25, "friction force"),),
    strength=NAME,
    jumps=True,
    rounding=ROUNDING,
    trials=lambda scale: [{NAME: 0.001 * scale.force, ROUNDING: scale.rate / r} for r in ROUNDINGS],
    law=force_law,
    fits=("guide", "pendulum", "damper", "spring", "joint", "contact"),
    constants=lambda values, rest: (values[NAME], values[ROUNDING]),
    statement=lambda values, name: (
        f"The {name} rubs: a dry friction of {values[NAME]:.4g} N works against the motion, whatever its speed."
    ),
)
