"""Drag: damping as the square of the speed."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity
from sim_backend.mechanisms.quadratic_damping import force_law

NAME = "quadratic_damping_n_s2_per_m2"

MECHANISM = Mechanism(
    id="quadratic_damping",
    component="upper mass",
    summary="force of v abs(v)",
    source="drag of a fluid at high Reynolds number",
    parameters=(Quantity(NAME, "N s2/m2", 0.0, 1e25, "coefficient of the squared speed"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 0.001 * scale.force / scale.rate**2}],
    law=force_law,
    constants=lambda values, rest: (values[NAME],),
    fits=("damper", "pendulum", "guide", "spring", "joint", "contact"),
    statement=lambda values: (
        f"The {{element}} is held back by drag: {values[NAME]:.4g} times the squared speed, beside what linear "
        "damping there is."
    ),
)
