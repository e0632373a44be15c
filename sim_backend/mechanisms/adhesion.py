"""Attraction between the surfaces that falls off as they part."""

from __future__ import annotations

import math

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Attraction p[4] while pressed, fading as exp(-gap / p[5]) on the way out; at rest it is part of the preload."""
    if d >= 0.0:
        return force
    return force - p[4] * math.expm1(d / p[5])


MECHANISM = Mechanism(
    id="adhesion",
    component="contact",
    acts="contact",
    summary="attraction on the way out (meniscus, DMT)",
    source="Derjaguin, Muller, Toporov; meniscus forces",
    parameters=(
        Quantity("adhesion_force_share", "1", 0.0, 1.0, "attraction over the preload"),
        Quantity("adhesion_range_share", "1", 1e-3, 1e3, "its range over P / k_c", log=True),
    ),
    strength="adhesion_force_share",
    trials=lambda scale: [
        {"adhesion_force_share": 1e-3, "adhesion_range_share": scale.deformation / scale.static * r}
        for r in (0.1, 0.5, 3.0, 30.0)
    ],
    law=force_law,
    constants=lambda values, rest: (
        values["adhesion_force_share"] * rest.preload,
        values["adhesion_range_share"] * rest.preload / rest.stiffness,
    ),
    statement=lambda values: (
        f"On the way out the surfaces attract each other with up to {100 * values['adhesion_force_share']:.2g} % "
        "of the load."
    ),
)
