"""An accelerometer also shows the strain of the surface that it is mounted on, which the contact's force makes.

What two on one body have alike is taken up by the motion, which is free: it is their difference that shows.
"""

from __future__ import annotations

from dataclasses import replace

from sim_backend.arrangement import Arrangement, Parameter
from sim_backend.mechanisms.cross_axis_sensitivity import at as each_accelerometer
from sim_backend.mechanisms.kinds import AddedBody, Quantity, Values
from sim_backend.mechanisms.places import Place

NAME = "base_strain_m_s2_per_n"


def at(rig: Arrangement) -> list[Place]:
    """Return the contact with the last of the accelerometers on a body that it pushes."""
    last = {(place[0], rig.sensors[place[1]].row): place for place in each_accelerometer(rig)}
    return list(last.values())


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Let the sensor show the contact's force, too."""
    strained = (rig.elements[place[0]].name, NAME)
    sensors = tuple(replace(s, strained=strained) if i == place[1] else s for i, s in enumerate(rig.sensors))
    return rig.extended(parameters=(Parameter(NAME, "m/s2/N", values[NAME]),), sensors=sensors)


MECHANISM = AddedBody(
    id="base_strain",
    component="sensor chain",
    summary="one accelerometer shows more of the strain of its base than the other",
    source="ISO 16063-32; IEST-RP-DTE011: base strain sensitivity",
    parameters=(
        Quantity(NAME, "m/N s2", -1e6, 1e6, "what B shows more than A for each newton of the contact's force"),
    ),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-3 / scale.mass}],
    extend=extend,
    at=at,
    on_sensor=True,
    shaken=False,
    one_signed=False,
    statement=lambda values, name: (
        f"{name[:1].upper()}{name[1:]} shows the strain of its base, {values[NAME]:+.3g} m/s2 more than the others for "
        "each newton of the contact's force."
    ),
)
