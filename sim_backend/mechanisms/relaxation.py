"""A spring in series with a damper beside an element: it relaxes."""

from __future__ import annotations

import math

from sim_backend.force_law import STEP
from sim_backend.mechanisms.kinds import ForceLaw, Quantity, geometric, law

STIFFNESS, TIME, CARRIED = "relaxing_stiffness_n_per_m", "relaxation_time_s", "carried_force_n"
FORCE, RATE, BEGUN = range(3)  # memory


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """f' + f / tau = k v; p[4] = k, p[5] = tau, p[6] = f at first; exact for a rate that is straight over a step."""
    z = p[STEP] / p[5]
    grown = math.exp(-z)
    mean = (1.0 - grown) / z
    second = (1.0 - mean) / z
    own = p[6]
    if before[BEGUN] > 0.0:
        own = before[FORCE] * grown + p[4] * p[STEP] * (before[RATE] * (mean - second) + v * second)
    after[FORCE], after[RATE], after[BEGUN] = own, v, 1.0
    return force + own


MECHANISM = ForceLaw(
    id="relaxation",
    component="tube springs",
    summary="a spring in series with a damper beside the element",
    source="Maxwell; standard linear solid",
    parameters=(
        Quantity(STIFFNESS, "N/m", 0.0, 1e25, "stiffness that relaxes"),
        Quantity(TIME, "s", 1e-9, 1e9, "relaxation time", log=True),
    ),
    strength=STIFFNESS,
    trials=lambda scale: [
        {STIFFNESS: 1e-3 * scale.force / scale.deformation, TIME: tau}
        for tau in geometric(0.03 / scale.frequency_hz[1], 3.0 / scale.frequency_hz[0], 3)
    ],
    law=force_law,
    constants=lambda values, rest: (values[STIFFNESS], values[TIME], values.get(CARRIED, 0.0)),
    carried=CARRIED,
    fits=("spring", "joint", "contact", "damper"),
    statement=lambda values, name: (
        f"The {name} relaxes: {values[STIFFNESS]:.4g} N/m of its stiffness do so with a time constant of "
        f"{values[TIME]:.3g} s."
    ),
)
