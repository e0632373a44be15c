"""An accelerometer also shows motion across its axis: a lateral mode of the body that the contact sets going."""

from __future__ import annotations

import math
from dataclasses import replace

from sim_backend.arrangement import Arrangement, Element, Parameter
from sim_backend.mechanisms.kinds import AddedBody, Quantity, Scale, Values, geometric
from sim_backend.mechanisms.places import Place, channels_alike, unused_name

SHARE, STIFFNESS, DAMPING, MASS = (
    "cross_axis_share",
    "lateral_stiffness_n_per_m",
    "lateral_damping_n_s_per_m",
    "lateral_mass_kg",
)
TRIAL_RATIO = 0.015
LOWEST, HIGHEST = 1.2, 4.5  # resonances tried, from the lowest mode times this to the highest times this
TRIED = 24  # resonances


def at(rig: Arrangement) -> list[Place]:
    """Return the contact that pushes a body with two or more accelerometers on it, and each of these by itself."""
    found: list[Place] = []
    for group in channels_alike(rig):
        row, quantity = rig.sensors[group[0]].row, rig.sensors[group[0]].quantity
        if len(group) < 2 or len(row) > 1 or quantity != "acceleration":
            continue
        pushing = [i for i, e in enumerate(rig.elements) if e.preload and row[0][0] in dict(e.row)]
        found += [(i, sensor) for i in pushing for sensor in group]
    return found


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Add the lateral motion as the sensor shows it, which the contact drives."""
    contact, sensor = rig.elements[place[0]], rig.sensors[place[1]]
    lateral = unused_name("lateral motion", rig.bodies)
    mount = unused_name("lateral spring", [e.name for e in rig.elements])
    shows = replace(sensor, row=(*sensor.row, (lateral, 1.0)))
    return rig.extended(
        bodies={lateral: MASS},
        changed={contact.name: replace(contact, row=(*contact.row, (lateral, SHARE)))},
        elements=(Element(mount, "body", "lower mass", ((lateral, 1.0),), STIFFNESS, DAMPING),),
        parameters=(
            Parameter(MASS, "kg", values[MASS], 1e-6 * values[MASS]),
            Parameter(SHARE, "1", values[SHARE]),
            Parameter(STIFFNESS, "N/m", values[STIFFNESS], positive=True),
            Parameter(DAMPING, "N s/m", values[DAMPING], positive=True),
        ),
        sensors=tuple(shows if i == place[1] else s for i, s in enumerate(rig.sensors)),
    )


def trials(scale: Scale) -> list[dict[str, float]]:
    """Return small shares, with lateral resonances above the rig's lowest mode."""
    low = LOWEST * scale.frequency_hz[0]
    high = max(min(HIGHEST * scale.frequency_hz[1], scale.shown_hz), 2 * low)
    omegas = [2 * math.pi * f for f in geometric(low, high, TRIED)]
    mass = scale.mass
    return [{SHARE: 1e-4, STIFFNESS: mass * w**2, DAMPING: 2 * TRIAL_RATIO * mass * w, MASS: mass} for w in omegas]


def frequency_hz(values: Values) -> float:
    """Return the resonance across the axis, Hz."""
    return math.sqrt(values[STIFFNESS] / values[MASS]) / (2 * math.pi)


MECHANISM = AddedBody(
    id="cross_axis_sensitivity",
    component="sensor chain",
    summary="one accelerometer also shows motion across its axis",
    source="ISO 16063-31: transverse sensitivity",
    parameters=(
        Quantity(SHARE, "1", -0.5, 0.5, "transverse sensitivity times lateral over normal force of the contact"),
        Quantity(STIFFNESS, "N/m", 1e-3, 1e15, "stiffness across the axis, for the mass of the body", log=True),
        Quantity(DAMPING, "N s/m", 1e-9, 1e10, "damping across the axis", log=True),
    ),
    strength=SHARE,
    trials=trials,
    extend=extend,
    at=at,
    body=(MASS, STIFFNESS, DAMPING),
    one_signed=False,
    on_sensor=True,
    shaken=False,
    statement=lambda values, name: (
        f"{name[:1].upper()}{name[1:]} also shows motion across its axis: {100 * abs(values[SHARE]):.2g} % of what "
        f"the contact's force would give the body alone, which resonates at {frequency_hz(values):.0f} Hz."
    ),
)
