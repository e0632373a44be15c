"""A body turns because what holds it is off its axis: two sensors on it differ with opposite sign."""

from __future__ import annotations

import math
from dataclasses import replace

from sim_backend.arrangement import Arrangement, Element, Parameter, Sensor
from sim_backend.mechanisms.kinds import AddedBody, Quantity, Scale, Values, geometric
from sim_backend.mechanisms.places import Place, channels_alike, unused_name

OFFSET, STIFFNESS, DAMPING, INERTIA = (
    "contact_offset_share",
    "rocking_stiffness_n_per_m",
    "rocking_damping_n_s_per_m",
    "rocking_inertia_kg",
)
SHARE_OF_MASS = 1 / 3  # of the body: inertia of a block over the square of the accelerometers' distance
TRIAL_RATIO = 0.015
LOWEST, HIGHEST = 2.5, 4.5  # resonances tried, from the lowest mode times this to the highest times this
TRIED = 40  # resonances: neighbours lie within the width of a mount that is damped like the trial's


TURNING = ("contact", "joint")  # roles of what turns a body; a spring does where a body has neither


def at(rig: Arrangement) -> list[Place]:
    """Return an element on a body that can turn it, and two channels that see this body alone."""
    found = []
    for group in channels_alike(rig):
        row = rig.sensors[group[0]].row
        if len(group) < 2 or len(row) > 1:
            continue
        touching = [i for i, e in enumerate(rig.elements) if row[0][0] in dict(e.row)]
        likely = [i for i in touching if rig.elements[i].role in TURNING]
        found += [(i, *group[:2]) for i in likely or touching]
    return found


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Add the displacement that turning makes at the first sensor; the element drives it by its lever arm."""
    element, a, b = rig.elements[place[0]], rig.sensors[place[1]], rig.sensors[place[2]]
    turn = unused_name("turning", rig.bodies)
    body = a.row[0][0]
    inertia = SHARE_OF_MASS * rig.declared()[rig.masses[rig.bodies.index(body)]]
    turned = {a.name: Sensor(a.name, (*a.row, (turn, 1.0)), a.quantity)}
    turned[b.name] = Sensor(b.name, (*b.row, (turn, -1.0)), b.quantity)
    spring = unused_name("rocking spring", [e.name for e in rig.elements])
    return rig.extended(
        bodies={turn: INERTIA},
        changed={element.name: replace(element, row=(*element.row, (turn, OFFSET)))},
        elements=(Element(spring, "body", "lower mass", ((turn, 1.0),), STIFFNESS, DAMPING),),
        parameters=(
            Parameter(INERTIA, "kg", inertia, 1e-6 * inertia),
            Parameter(OFFSET, "1", values[OFFSET]),
            Parameter(STIFFNESS, "N/m", values[STIFFNESS], positive=True),
            Parameter(DAMPING, "N s/m", values[DAMPING], positive=True),
        ),
        sensors=tuple(turned.get(s.name, s) for s in rig.sensors),
    )


def trials(scale: Scale) -> list[dict[str, float]]:
    """Return small offsets, with resonances of turning above the rig's lowest mode."""
    inertia = SHARE_OF_MASS * scale.mass
    low = LOWEST * scale.frequency_hz[0]
    high = max(min(HIGHEST * scale.frequency_hz[1], scale.shown_hz), 2 * low)
    omegas = [2 * math.pi * f for f in geometric(low, high, TRIED)]
    return [{OFFSET: 1e-3, STIFFNESS: inertia * w**2, DAMPING: 2 * TRIAL_RATIO * inertia * w} for w in omegas]


MECHANISM = AddedBody(
    id="rocking",
    component="lower mass",
    summary="a body turns; its two sensors differ with opposite sign",
    source="rigid body with an eccentric contact",
    parameters=(
        Quantity(OFFSET, "1", -1.0, 1.0, "offset of what turns it over the accelerometers' distance from the axis"),
        Quantity(STIFFNESS, "N/m", 1e-3, 1e15, "stiffness against turning, at the accelerometers", log=True),
        Quantity(DAMPING, "N s/m", 1e-9, 1e10, "damping of turning, at the accelerometers", log=True),
    ),
    strength=OFFSET,
    trials=trials,
    extend=extend,
    at=at,
    body=(INERTIA, STIFFNESS, DAMPING),
    one_signed=False,
    shaken=False,
    statement=lambda values, name: (
        f"A body at the {name}, which pushes off its axis, turns as well as moves, held against turning by "
        f"{values[STIFFNESS]:.3g} N/m at its two sensors, which differ with opposite sign."
    ),
)
