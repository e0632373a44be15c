"""An element dissipates that is said to have no damper, as the tube springs in Eq. 9."""

from __future__ import annotations

from dataclasses import replace

from sim_backend.arrangement import Arrangement, Parameter
from sim_backend.mechanisms.kinds import AddedBody, Derived, Quantity, Values
from sim_backend.mechanisms.places import Place, fitting_elements

NAME = "c_n_s_per_m"


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Put the same damper beside every element of the place."""
    damped = {rig.elements[i].name: replace(rig.elements[i], damping=NAME) for i in place}
    return rig.extended(changed=damped, parameters=(Parameter(NAME, "N s/m", values[NAME]),))


MECHANISM = AddedBody(
    id="tube_spring_damping",
    component="tube springs",
    summary="linear damping where the rig is said to have none, as of the tube springs in Eq. 9",
    source="material damping of the rings; Kelvin and Voigt",
    parameters=(Quantity(NAME, "N s/m", 0.0, 1e25, "damper beside each element"),),
    derived=tuple(
        Derived(f"c{i}_n_s_per_m", "N s/m", lambda values: values[NAME], meaning=f"damper beside k{i}") for i in (1, 2)
    ),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-4 * scale.force / scale.rate}],
    extend=extend,
    at=lambda rig: fitting_elements(rig, ("spring", "joint", "contact", "guide", "pendulum"), undamped=True),
    statement=lambda values, name: (
        f"The {name} dissipate as with a damper of {values[NAME]:.3g} N s/m beside each."
        if name.endswith("springs")
        else f"The {name} dissipates as with a damper of {values[NAME]:.3g} beside it."
    ),
)
