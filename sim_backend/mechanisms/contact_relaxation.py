"""Part of the contact's stiffness relaxes: a film, an adhesive or a polymer between the surfaces."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity
from sim_backend.mechanisms.relaxation import CARRIED, force_law

SHARE, TIME = "relaxing_share", "relaxation_time_s"

MECHANISM = ForceLaw(
    id="contact_relaxation",
    component="contact",
    summary="part of the contact's stiffness relaxes",
    source="Maxwell; standard linear solid",
    parameters=(
        Quantity(SHARE, "1", 0.0, 10.0, "stiffness that relaxes, over k_c"),
        Quantity(TIME, "s", 1e-9, 1e9, "relaxation time", log=True),
    ),
    strength=SHARE,
    trials=lambda scale: [{SHARE: 1e-3, TIME: 0.2 / scale.frequency_hz[1]}],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (values[SHARE] * rest.stiffness, values[TIME], values.get(CARRIED, 0.0)),
    carried=CARRIED,
    hidden=(
        "A decay shows the contact at one frequency for each load, and what relaxes adds to k_c and c_c there: where "
        "30 % of k_c relax within a period, no more than about one standard deviation of a session's noise is left. A "
        "steady response swept over a decade of frequency tells it, or k_c against the stiffness of slow loading."
    ),
    statement=lambda values, name: (
        f"{100 * values[SHARE]:.2g} % of the {name}'s stiffness relaxes with a time constant of {values[TIME]:.3g} s."
    ),
)
