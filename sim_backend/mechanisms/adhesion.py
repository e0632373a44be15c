"""Attraction between the surfaces that depends on their distance alone: it gives back what it takes."""

from __future__ import annotations

import math

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Attraction p[4] at rest, where it is part of the preload, fading as exp(-gap / p[5]) as the surfaces part."""
    return force - p[4] * (math.exp(min(d, 0.0) / p[5]) - 1.0)


MECHANISM = ForceLaw(
    id="adhesion",
    component="contact",
    summary="attraction that falls off as the surfaces part (DMT)",
    source="Derjaguin, Muller and Toporov, J. Colloid Interface Sci. 53 (1975) 314",
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
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (
        values["adhesion_force_share"] * rest.preload,
        values["adhesion_range_share"] * rest.preload / rest.stiffness,
    ),
    statement=lambda values, name: (
        f"The surfaces attract each other with up to {100 * values['adhesion_force_share']:.2g} % of the load, whether "
        "they part or approach."
    ),
)
