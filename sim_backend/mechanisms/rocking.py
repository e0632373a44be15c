"""The lower mass turns because the contact is off its axis: A and B differ with opposite sign."""

from __future__ import annotations

import math
from dataclasses import replace

from sim_backend.arrangement import Arrangement, Element, Parameter, Sensor
from sim_backend.mechanisms.mechanism import Mechanism, Quantity, Values, geometric

OFFSET, STIFFNESS, DAMPING, INERTIA = (
    "contact_offset_share",
    "rocking_stiffness_n_per_m",
    "rocking_damping_n_s_per_m",
    "rocking_inertia_kg",
)
TURN = "turning"
SHARE_OF_MASS = 1 / 3  # of the lower mass: inertia of a block over the square of the accelerometers' distance
TRIAL_RATIO = 0.015


def extend(rig: Arrangement, values: Values) -> Arrangement:
    """Add the displacement that turning makes at accelerometer A; the contact drives it by its lever arm."""
    contact = next(e for e in rig.elements if e.role == "contact")
    a, b = rig.sensors
    inertia = SHARE_OF_MASS * rig.declared()["m2"]
    return rig.extended(
        bodies={TURN: INERTIA},
        changed={contact.name: replace(contact, row=(*contact.row, (TURN, OFFSET)))},
        elements=(Element("rocking spring", "body", "lower mass", ((TURN, 1.0),), STIFFNESS, DAMPING),),
        parameters=(
            Parameter(INERTIA, "kg", inertia, 1e-6 * inertia),
            Parameter(OFFSET, "1", values[OFFSET]),
            Parameter(STIFFNESS, "N/m", values[STIFFNESS], positive=True),
            Parameter(DAMPING, "N s/m", values[DAMPING], positive=True),
        ),
        sensors=(Sensor(a.name, (*a.row, (TURN, 1.0)), a.quantity), Sensor(b.name, (*b.row, (TURN, -1.0)), b.quantity)),
    )


def _trial(frequency_hz: float) -> dict[str, float]:
    omega, inertia = 2 * math.pi * frequency_hz, 0.036
    return {OFFSET: 1e-3, STIFFNESS: inertia * omega**2, DAMPING: 2 * TRIAL_RATIO * inertia * omega}


MECHANISM = Mechanism(
    id="rocking",
    component="lower mass",
    acts="body",
    summary="the mass turns; A and B differ with opposite sign",
    source="rigid body with an eccentric contact",
    parameters=(
        Quantity(OFFSET, "1", -1.0, 1.0, "offset of the contact over the accelerometers' distance from the axis"),
        Quantity(STIFFNESS, "N/m", 1e3, 1e10, "stiffness against turning, at the accelerometers", log=True),
        Quantity(DAMPING, "N s/m", 1e-4, 1e5, "damping of turning, at the accelerometers", log=True),
    ),
    strength=OFFSET,
    trials=lambda scale: [_trial(f) for f in geometric(900.0, 9000.0, 40)],
    extend=extend,
    body=(INERTIA, STIFFNESS, DAMPING),
    one_signed=False,
    statement=lambda values: (
        f"The lower mass turns as well as moves, with a resonance near "
        f"{math.sqrt(values[STIFFNESS] / 0.036) / (2 * math.pi):.0f} Hz: A and B differ with opposite sign, "
        "as of a contact off the axis."
    ),
)
