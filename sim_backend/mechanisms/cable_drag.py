"""The cables of the accelerometers drag on the mass that carries them."""

from __future__ import annotations

from sim_backend.arrangement import Arrangement, Element, Parameter
from sim_backend.mechanisms.kinds import AddedBody, Quantity, Values
from sim_backend.mechanisms.places import Place, channels_alike, unused_name

NAME = "cable_damping_n_s_per_m"


def at(rig: Arrangement) -> list[Place]:
    """Return the bodies that accelerometers ride on."""
    riding = [
        rig.sensors[g[0]].row[0][0]
        for g in channels_alike(rig)
        if rig.sensors[g[0]].quantity == "acceleration" and len(rig.sensors[g[0]].row) == 1
    ]
    return [(rig.bodies.index(body),) for body in dict.fromkeys(riding)]


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Put a damper between the body and the ground."""
    cable = unused_name("cable", [e.name for e in rig.elements])
    return rig.extended(
        elements=(Element(cable, "body", "lower mass", ((rig.bodies[place[0]], 1.0),), damping=NAME),),
        parameters=(Parameter(NAME, "N s/m", values[NAME]),),
    )


MECHANISM = AddedBody(
    id="cable_drag",
    component="lower mass",
    summary="the accelerometers' cables drag on the mass",
    source="a taut string's wave impedance, the root of tension times mass per length",
    parameters=(Quantity(NAME, "N s/m", 0.0, 1e25, "damper between the mass and the ground"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-4 * scale.force / scale.rate}],
    extend=extend,
    at=at,
    on_body=True,
    hidden=(
        "A damper to the ground damps the mode in which both masses move together, as damping of the tube springs "
        "does, and adds to c_c: one answer stands for both, of which the cable's damper is twice as large. A second "
        "cable, or one that is held elsewhere, tells them apart."
    ),
    same_as=("tube_spring_damping",),
    statement=lambda values, name: (
        f"The cables drag on the {name} as a damper of {values[NAME]:.3g} N s/m to the ground would."
    ),
)
