"""Contact damping that grows with the approach."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """c (1 + g d / delta) v with delta = P / k; never below zero damping."""
    return force + p[2] * max(p[4] * p[1] * d / p[0], -1.0) * v


MECHANISM = ForceLaw(
    id="hunt_crossley_damping",
    component="contact",
    summary="damping that grows with approach",
    source="Hunt and Crossley, J. Appl. Mech. 42 (1975) 440",
    parameters=(
        Quantity("damping_growth_per_relative_approach", "1", 0.0, 20.0, "relative growth of c_c for d = P / k_c"),
    ),
    strength="damping_growth_per_relative_approach",
    trials=lambda scale: [{"damping_growth_per_relative_approach": 0.1}],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (values["damping_growth_per_relative_approach"],),
    statement=lambda values, name: (
        "The contact's damping grows with the approach: pressed together by one static approach it would be "
        f"{1 + values['damping_growth_per_relative_approach']:.2g} times that at rest."
    ),
)
