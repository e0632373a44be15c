"""First loading of a contact is softer than unloading: asperities yield, and what they yield by stays."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

SHARE = "yielding_share"
LARGEST = 0  # memory: largest approach beyond rest so far


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """k (d - g) + k (1 - s) g with g the largest approach so far, in the place of k d: less by s k g. p[4] = s k."""
    largest = max(before[LARGEST], d)
    after[LARGEST] = largest
    return force - p[4] * largest


MECHANISM = ForceLaw(
    id="plastic_loading",
    component="contact",
    summary="asperities yield on first loading; unloading is stiffer",
    source="Walton and Braun, J. Rheol. 30 (1986) 949; Kim, Baltazar and Rokhlin, J. Mech. Phys. Solids 52 (2004) 1911",
    parameters=(
        Quantity(SHARE, "1", 0.0, 0.95, "by what share loading is softer than unloading, whose stiffness is k_c"),
    ),
    strength=SHARE,
    trials=lambda scale: [{SHARE: 1e-3}],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (values[SHARE] * rest.stiffness,),
    hidden=(
        "Asperities yield while the tap presses them further than ever before; from then on the contact is elastic, "
        "and what stays is a change of its rest position, which accelerometers do not show. k_c is the stiffness of "
        "unloading. Loads that are stepped up and then down tell it: on the way down k_c is larger at the same load."
    ),
    statement=lambda values, name: (
        f"The {name} yields when it is loaded for the first time: {100 * values[SHARE]:.2g} % softer than on unloading."
    ),
)
