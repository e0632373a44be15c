"""The tube springs dissipate; Eq. 9 lets them not."""

from __future__ import annotations

from dataclasses import replace

from sim_backend.arrangement import Arrangement, Parameter
from sim_backend.mechanisms.mechanism import Derived, Mechanism, Quantity, Values

NAME = "c_n_s_per_m"


def extend(rig: Arrangement, values: Values) -> Arrangement:
    """Put the same damper beside every spring."""
    springs = {e.name: replace(e, damping=NAME) for e in rig.elements if e.role == "spring"}
    return rig.extended(changed=springs, parameters=(Parameter(NAME, "N s/m", values[NAME]),))


MECHANISM = Mechanism(
    id="tube_spring_damping",
    component="tube springs",
    acts="spring",
    summary="the tube springs dissipate; Eq. 9 has no damper there",
    source="material damping of the rings",
    parameters=(Quantity(NAME, "N s/m", 0.0, 1e3, "damper beside each tube spring"),),
    derived=tuple(Derived(f"c{i}_n_s_per_m", "N s/m", lambda values: values[NAME]) for i in (1, 2)),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-4 * scale.force / scale.rate}],
    extend=extend,
    statement=lambda values: (
        f"The tube springs dissipate: each acts as with a damper of {values[NAME]:.3g} N s/m beside it, so that the "
        "system mode decays by itself."
    ),
)
