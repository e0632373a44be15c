"""Menisci between the surfaces: they stretch as these part, and do not pull as they approach; each cycle takes work."""

from __future__ import annotations

import math

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

FORCE, RANGE, SPEED = "meniscus_force_share", "meniscus_range_share", "sets_in_m_per_s"
SETS_IN = (0.4, 0.8, 1.5)  # of the rate after a tap: where menisci pull half as much again, or half as much


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Attraction of p[4] at rest, where it is part of the preload, fading as exp(-gap / p[5]).

    It grows to twice that as the surfaces part faster than p[6] (m/s), and ceases as they approach so fast.
    """
    opening = 1.0 - math.tanh(v / p[6])
    return force - p[4] * (opening * math.exp(min(d, 0.0) / p[5]) - 1.0)


MECHANISM = ForceLaw(
    id="menisci",
    component="contact",
    summary="menisci pull as the surfaces part, not as they approach",
    source="Crassous, Charlaix and Loubet, Phys. Rev. Lett. 78 (1997) 2425: hysteresis of capillary bridges",
    parameters=(
        Quantity(FORCE, "1", 0.0, 1.0, "pull over the preload"),
        Quantity(RANGE, "1", 1e-3, 1e3, "its range over P / k_c", log=True),
        Quantity(SPEED, "m/s", 1e-7, 1.0, "speed of parting at which menisci pull", log=True),
    ),
    strength=FORCE,
    trials=lambda scale: [
        {FORCE: 1e-3, RANGE: scale.deformation / scale.static * r, SPEED: share * scale.rate}
        for share in SETS_IN
        for r in (0.1, 0.5, 3.0, 30.0)
    ],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (
        0.5 * values[FORCE] * rest.preload,
        values[RANGE] * rest.preload / rest.stiffness,
        values[SPEED],
    ),
    statement=lambda values, name: (
        f"Menisci pull with up to {100 * values[FORCE]:.2g} % of the load while the surfaces part, and not while they "
        "approach."
    ),
)
