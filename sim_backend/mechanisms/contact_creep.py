"""The contact stiffens with the time since the blow."""

from __future__ import annotations

import math

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """k (1 + e ln(1 + t / tau)) in the place of k; p[4] = e, p[5] = tau."""
    return force + p[1] * p[4] * math.log1p(t / p[5]) * d


MECHANISM = Mechanism(
    id="contact_creep",
    component="contact",
    acts="contact",
    summary="the contact stiffens with dwell time",
    source="logarithmic ageing of contacts",
    parameters=(
        Quantity("creep_per_e_fold", "1", -0.5, 0.5, "relative stiffening for each e-fold of time"),
        Quantity("creep_time_s", "s", 1e-4, 10.0, "time from which on it counts", log=True),
    ),
    strength="creep_per_e_fold",
    trials=lambda scale: [{"creep_per_e_fold": 1e-5, "creep_time_s": tau} for tau in (1e-3, 1e-2, 1e-1)],
    law=force_law,
    constants=lambda values, rest: (values["creep_per_e_fold"], values["creep_time_s"]),
    one_signed=False,
    statement=lambda values: (
        f"The contact stiffens by {100 * values['creep_per_e_fold']:.2g} % for each e-fold of time after the blow."
    ),
)
