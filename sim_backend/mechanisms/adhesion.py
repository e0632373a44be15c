"""Attraction between the surfaces that falls off as they part; of menisci that stretch then, and do not pull before."""

from __future__ import annotations

import math

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

SETS_IN = (0.4, 0.8, 1.5)  # of the rate after a tap: where menisci pull half as much again, or half as much


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Attraction p[4] at rest, where it is part of the preload, fading as exp(-gap / p[5]).

    That of menisci grows to twice that as the surfaces part faster than p[6] (m/s), and ceases as they approach so
    fast; other attraction acts on both ways (p[6] infinite).
    """
    opening = 1.0 - math.tanh(v / p[6])
    return force - p[4] * (opening * math.exp(min(d, 0.0) / p[5]) - 1.0)


MECHANISM = ForceLaw(
    id="adhesion",
    component="contact",
    summary="attraction on the way out (meniscus, DMT)",
    source="Derjaguin, Muller, Toporov; menisci that stretch as the surfaces part",
    parameters=(
        Quantity("adhesion_force_share", "1", 0.0, 1.0, "attraction over the preload"),
        Quantity("adhesion_range_share", "1", 1e-3, 1e3, "its range over P / k_c", log=True),
        Quantity("sets_in_m_per_s", "m/s", 1e-7, 1.0, "speed of parting at which menisci pull", log=True),
    ),
    strength="adhesion_force_share",
    trials=lambda scale: [
        {
            "adhesion_force_share": 1e-3,
            "adhesion_range_share": scale.deformation / scale.static * r,
            "sets_in_m_per_s": share * scale.rate,
            "menisci": menisci,
        }
        for menisci, share in ((0.0, 1.0), *((1.0, share) for share in SETS_IN))
        for r in (0.1, 0.5, 3.0, 30.0)
    ],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (
        values["adhesion_force_share"] * rest.preload * (0.5 if values["menisci"] else 1.0),
        values["adhesion_range_share"] * rest.preload / rest.stiffness,
        values["sets_in_m_per_s"] if values["menisci"] else math.inf,
    ),
    statement=lambda values, name: (
        f"On the way out the surfaces attract each other with up to {100 * values['adhesion_force_share']:.2g} % "
        "of the load."
    ),
)
