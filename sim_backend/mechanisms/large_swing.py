"""A pendulum whose swings are large: its weight pulls it back with the sine of its angle."""

from __future__ import annotations

import math

from sim_backend.force_law import STIFFNESS
from sim_backend.mechanisms.kinds import ForceLaw, Quantity, Values, law

NAME = "arc_curvature_per_m2"
AS_AN_ANGLE = 0.02  # relative distance up to which a deflection is taken for the angle in a unit


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """k (sin(a) / a - 1) d, where a = d sqrt(p[4])."""
    a = d * math.sqrt(max(p[4], 0.0))
    if abs(a) < 1e-3:  # of the sine the cube
        return force - p[STIFFNESS] * a * a / 6.0 * d
    return force + p[STIFFNESS] * (math.sin(a) / a - 1.0) * d


def _told(values: Values) -> str:
    """Say in which unit the deflection is that angle; of one along an arc, how long the arc's radius is."""
    curvature = math.sqrt(values[NAME])
    units = {"in rad": 1.0, "in degrees": math.pi / 180}
    angle = [unit for unit, per in units.items() if abs(curvature / per - 1) < AS_AN_ANGLE]
    return (
        f", which is recorded {angle[0]}"
        if angle
        else f", which is {curvature:.4g} times the deflection, as on an arc of radius {1 / curvature:.4g}"
    )


MECHANISM = ForceLaw(
    id="large_swing",
    component="contact",
    summary="a restoring force that goes with the sine of a pendulum's angle",
    source="pendulum of large swings",
    parameters=(
        Quantity(
            NAME, "1/m2", 0.0, 1e25, "square of the angle over that of the deflection; 1 where that is in rad", log=True
        ),
    ),
    strength=NAME,
    trials=lambda scale: [{NAME: 0.018 / scale.deformation**2}],
    law=force_law,
    fits=("pendulum",),
    constants=lambda values, rest: (values[NAME],),
    statement=lambda values, name: f"The {name} swings far: its force goes with the sine of its angle{_told(values)}.",
)
