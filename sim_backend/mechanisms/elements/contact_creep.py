"""Stiffness and damping that settle with time, whatever the amplitude."""

from __future__ import annotations

import math

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, law

STIFFNESS, DAMPING, TIME = "stiffness_change_n_per_m", "damping_change_n_s_per_m", "settling_time_s"


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """(p[4] d + p[5] v) (1 - e^(-t / p[6]))."""
    return force + (p[4] * d + p[5] * v) * -math.expm1(-t / p[6])


MECHANISM = Mechanism(
    id="contact_creep",
    component="contact",
    summary="stiffness and damping that change with time",
    source="ageing, creep, warming",
    parameters=(
        Quantity(STIFFNESS, "N/m", -1e25, 1e25, "what the stiffness gains in the end"),
        Quantity(DAMPING, "N s/m", -1e25, 1e25, "what the damping gains in the end"),
        Quantity(TIME, "s", 1e-9, 1e9, "time it takes", log=True),
    ),
    strength=STIFFNESS,
    trials=lambda scale: [
        {
            STIFFNESS: 1e-4 * scale.force / scale.deformation,
            DAMPING: 1e-4 * scale.force / scale.rate,
            TIME: share * scale.duration_s,
        }
        for share in (0.1, 0.5, 2.0)
    ],
    law=force_law,
    constants=lambda values, rest: (values[STIFFNESS], values[DAMPING], values[TIME]),
    one_signed=False,
    with_time=True,
    fits=("joint", "contact", "spring", "guide", "damper", "pendulum"),
    statement=lambda values: (
        f"The {{element}} changes with time, whatever the amplitude: its stiffness by {values[STIFFNESS]:+.4g} and its "
        f"damping by {values[DAMPING]:+.4g}, with a time constant of {values[TIME]:.3g} s."
    ),
)
