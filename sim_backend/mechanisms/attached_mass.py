"""A small part on a stiff mount rides on the lower mass: an accelerometer, a cable, a screw."""

from __future__ import annotations

import math

from sim_backend.arrangement import LOWER, Arrangement, Element, Parameter
from sim_backend.mechanisms.mechanism import Derived, Mechanism, Quantity, Values, geometric

MASS, STIFFNESS, DAMPING = "attached_mass_kg", "mount_stiffness_n_per_m", "mount_damping_n_s_per_m"
PART = "attached part"
TRIAL_RATIO = 0.02  # damping ratio of the mount that is tried
TRIAL_MASS = 1e-4
HIGHEST_HZ = 9000.0
LEAST_HZ = 1000.0  # a mount softer than that is no stiff one


def extend(rig: Arrangement, values: Values) -> Arrangement:
    """Mount one more body on the one that carries the first sensor."""
    carrier = rig.sensors[0].row[0][0] if LOWER not in rig.bodies else LOWER
    return rig.extended(
        bodies={PART: MASS},
        elements=(Element("mount", "body", "lower mass", ((PART, 1.0), (carrier, -1.0)), STIFFNESS, DAMPING),),
        parameters=tuple(
            Parameter(name, unit, values[name], positive=True)
            for name, unit in ((MASS, "kg"), (STIFFNESS, "N/m"), (DAMPING, "N s/m"))
        ),
    )


def frequency_hz(values: Values) -> float:
    """Resonance of the part on its mount, Hz."""
    return math.sqrt(values[STIFFNESS] / values[MASS]) / (2 * math.pi)


def damping_ratio(values: Values) -> float:
    """Damping of that resonance over critical."""
    return values[DAMPING] / 2 / math.sqrt(values[STIFFNESS] * values[MASS])


def _trial(frequency_hz: float) -> dict[str, float]:
    omega = 2 * math.pi * frequency_hz
    return {
        MASS: TRIAL_MASS,
        STIFFNESS: TRIAL_MASS * omega**2,
        DAMPING: 2 * TRIAL_RATIO * TRIAL_MASS * omega,
    }


MECHANISM = Mechanism(
    id="attached_mass",
    component="lower mass",
    acts="body",
    summary="a small part on a stiff mount: accelerometer, cable, screw",
    source="tuned absorber",
    parameters=(
        Quantity(MASS, "kg", 0.0, 0.05, "mass of the part", log=True),
        Quantity(STIFFNESS, "N/m", 1e2, 1e9, "stiffness of its mount", log=True),
        Quantity(DAMPING, "N s/m", 1e-4, 1e4, "damping of its mount", log=True),
    ),
    strength=MASS,
    trials=lambda scale: [
        _trial(f)
        for f in geometric(max(LEAST_HZ, 3 * scale.frequency_hz[0]), max(9000.0, 2 * scale.frequency_hz[1]), 24)
    ],
    extend=extend,
    body=(MASS, STIFFNESS, DAMPING),
    derived=(
        Derived("mount_frequency_hz", "Hz", frequency_hz, positive=True),
        Derived("mount_damping_ratio", "1", damping_ratio, positive=True),
    ),
    statement=lambda values: (
        f"A part rides on the lower mass on a mount that resonates at {frequency_hz(values):.0f} Hz."
    ),
)
