"""The lower tube spring stands on something that moves."""

from __future__ import annotations

import math
from dataclasses import replace

from sim_backend.arrangement import LOWER, Arrangement, Element, Parameter
from sim_backend.mechanisms.mechanism import Mechanism, Quantity, Values, geometric

MASS, STIFFNESS, DAMPING = "frame_mass_kg", "frame_stiffness_n_per_m", "frame_damping_n_s_per_m"
FRAME = "frame"
TRIAL_RATIO = 0.02
TRIAL_MASS = 1e3  # heavy: it hardly moves


def extend(rig: Arrangement, values: Values) -> Arrangement:
    """Put the foot of the spring under the sensed body on a body of its own."""
    carrier = LOWER if LOWER in rig.bodies else rig.sensors[0].row[0][0]
    foot = next((e for e in rig.elements if e.role == "spring" and e.row == ((carrier, 1.0),)), None)
    if foot is None:
        raise ValueError(f"no spring stands between {carrier} and the ground")
    return rig.extended(
        bodies={FRAME: MASS},
        changed={foot.name: replace(foot, row=((carrier, 1.0), (FRAME, -1.0)))},
        elements=(Element("frame's footing", "body", "frame", ((FRAME, 1.0),), STIFFNESS, DAMPING),),
        parameters=tuple(
            Parameter(name, unit, values[name], positive=True)
            for name, unit in ((MASS, "kg"), (STIFFNESS, "N/m"), (DAMPING, "N s/m"))
        ),
    )


def _trial(frequency_hz: float) -> dict[str, float]:
    omega = 2 * math.pi * frequency_hz
    return {MASS: TRIAL_MASS, STIFFNESS: TRIAL_MASS * omega**2, DAMPING: 2 * TRIAL_RATIO * TRIAL_MASS * omega}


MECHANISM = Mechanism(
    id="frame_compliance",
    component="frame",
    acts="spring",
    summary="the tube spring stands on something that moves",
    source="two-mass foundation model",
    parameters=(
        Quantity(MASS, "kg", 0.2, 1e5, "mass that moves", log=True),
        Quantity(STIFFNESS, "N/m", 1e4, 1e11, "stiffness below it", log=True),
        Quantity(DAMPING, "N s/m", 1e-2, 1e7, "damping below it", log=True),
    ),
    strength=None,
    trials=lambda scale: [_trial(f) for f in geometric(0.1 * scale.frequency_hz[0], 0.85 * scale.frequency_hz[0], 12)],
    extend=extend,
    body=(MASS, STIFFNESS, DAMPING),
    tied=True,
    statement=lambda values: (
        f"The lower tube spring stands on a frame that moves: {values[MASS]:.3g} kg that resonate at "
        f"{math.sqrt(values[STIFFNESS] / values[MASS]) / (2 * math.pi):.0f} Hz."
    ),
)
