"""An accelerometer also shows the strain of the surface that it is mounted on, which the contact's force makes."""

from __future__ import annotations

from dataclasses import replace

from sim_backend.arrangement import Arrangement, Parameter
from sim_backend.mechanisms.cross_axis_sensitivity import at
from sim_backend.mechanisms.kinds import AddedBody, Quantity, Values
from sim_backend.mechanisms.places import Place

NAME = "base_strain_m_s2_per_n"


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Let the sensor show the contact's force, too."""
    strained = (rig.elements[place[0]].name, NAME)
    sensors = tuple(replace(s, strained=strained) if i == place[1] else s for i, s in enumerate(rig.sensors))
    return rig.extended(parameters=(Parameter(NAME, "m/s2/N", values[NAME]),), sensors=sensors)


MECHANISM = AddedBody(
    id="base_strain",
    component="sensor chain",
    summary="one accelerometer also shows the strain of its base",
    source="ISO 16063-32; IEST-RP-DTE011: base strain sensitivity",
    parameters=(Quantity(NAME, "m/N s2", -1e6, 1e6, "what it shows for each newton of the contact's force"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-3 / scale.mass}],
    extend=extend,
    at=at,
    on_sensor=True,
    shaken=False,
    one_signed=False,
    statement=lambda values, name: (
        f"{name[:1].upper()}{name[1:]} also shows the strain of its base: {values[NAME]:+.3g} m/s2 for each newton of "
        "the contact's force."
    ),
)
