"""Dry friction between the upper mass and the frame."""

from __future__ import annotations

import math

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, law

ROUNDING = 50.0  # the sign of the speed is rounded below a fiftieth of the speed after a tap


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """F sign(v), p[4] = F; p[5] a speed far below those of the motion, within which it changes sign."""
    return force + p[4] * math.tanh(v / p[5])


MECHANISM = Mechanism(
    id="guide_friction",
    component="upper mass",
    acts="guide",
    summary="dry friction between m1 and the frame",
    source="Coulomb",
    parameters=(Quantity("friction_force_n", "N", 0.0, 1.0, "friction force"),),
    strength="friction_force_n",
    trials=lambda scale: [{"friction_force_n": 1e-5 * scale.force + 1e-9, "rounding": scale.rate / ROUNDING}],
    law=force_law,
    constants=lambda values, rest: (values["friction_force_n"], values["rounding"]),
    statement=lambda values: (
        f"The upper mass rubs against its guide with {1e3 * values['friction_force_n']:.3g} mN of dry friction."
    ),
)
