"""An element changes with time, whatever the amplitude: ageing, creep, warming.

A preloaded contact stiffens with the logarithm of the time since the impact, by a share of k_c. Any other element's
stiffness and damping settle exponentially.
"""

from __future__ import annotations

import math

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

STIFFNESS, DAMPING, TIME = "stiffness_change_n_per_m", "damping_change_n_s_per_m", "settling_time_s"


@law
def logarithmic_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """k (1 + e ln(1 + t / tau)) in the place of k; p[4] = e, p[5] = tau."""
    return force + p[1] * p[4] * math.log1p(t / p[5]) * d


@law
def settling_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """(p[4] d + p[5] v) (1 - e^(-t / p[6]))."""
    return force + (p[4] * d + p[5] * v) * -math.expm1(-t / p[6])


LOGARITHMIC = ForceLaw(
    id="contact_creep",
    component="contact",
    summary="the contact stiffens with time from the start of the tap; its damping stays",
    source="logarithmic ageing of contacts",
    parameters=(
        Quantity("creep_per_e_fold", "1", -0.5, 0.5, "relative stiffening for each e-fold of time"),
        Quantity("creep_time_s", "s", 1e-4, 10.0, "time after the tap begins, from which on it stiffens", log=True),
    ),
    strength="creep_per_e_fold",
    trials=lambda scale: [
        {"creep_per_e_fold": 1e-5, "creep_time_s": min(max(tau * scale.duration_s, 1e-4), 10.0)}
        for tau in (1e-2, 0.1, 1.0)
    ],
    law=logarithmic_law,
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (values["creep_per_e_fold"], values["creep_time_s"]),
    one_signed=False,
    with_time=True,
    statement=lambda values, name: (
        f"The {name} stiffens by {100 * values['creep_per_e_fold']:.2g} % for each e-fold of time after the impact."
    ),
)
SETTLING = ForceLaw(
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
    law=settling_law,
    fits=("joint", "contact", "spring", "guide", "damper", "pendulum"),
    preloaded=False,
    constants=lambda values, rest: (values[STIFFNESS], values[DAMPING], values[TIME]),
    one_signed=False,
    with_time=True,
    statement=lambda values, name: (
        f"The {name} changes with time, whatever the amplitude: its stiffness by {values[STIFFNESS]:+.4g} and its "
        f"damping by {values[DAMPING]:+.4g}, with a time constant of {values[TIME]:.3g} s."
    ),
)
MECHANISM = (LOGARITHMIC, SETTLING)
