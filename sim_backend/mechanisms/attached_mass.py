"""A small part on a mount rides on a body: an accelerometer, a cable, a screw."""

from __future__ import annotations

import math

from sim_backend.arrangement import Arrangement, Element, Parameter
from sim_backend.mechanisms.kinds import AddedBody, Derived, Quantity, Scale, Values, geometric
from sim_backend.mechanisms.places import Place, every_body, unused_name

MASS, STIFFNESS, DAMPING = "attached_mass_kg", "mount_stiffness_n_per_m", "mount_damping_n_s_per_m"
TRIAL_RATIO = 0.02  # damping ratio of the mount that is tried
TRIAL_SHARE = 3e-4  # of the body's mass: too little to change its motion other than in proportion
LOWEST, HIGHEST = 0.5, 4.5  # resonances tried, from the lowest mode times this to the highest times this
TRIED = 64  # resonances
LARGEST_KG = 1e3


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Mount one more body on the one in the place."""
    carrier = rig.bodies[place[0]]
    part = unused_name("attached part", rig.bodies)
    mount = unused_name("mount", [e.name for e in rig.elements])
    return rig.extended(
        bodies={part: MASS},
        elements=(Element(mount, "body", "lower mass", ((part, 1.0), (carrier, -1.0)), STIFFNESS, DAMPING),),
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


def trials(scale: Scale) -> list[dict[str, float]]:
    """Return light parts whose mounts resonate from below the rig's lowest mode to above its highest."""
    mass = min(TRIAL_SHARE * scale.mass, LARGEST_KG)
    low = LOWEST * scale.frequency_hz[0]
    high = max(min(HIGHEST * scale.frequency_hz[1], scale.shown_hz), 2 * low)
    omegas = [2 * math.pi * f for f in geometric(low, high, TRIED)]
    return [{MASS: mass, STIFFNESS: mass * w**2, DAMPING: 2 * TRIAL_RATIO * mass * w} for w in omegas]


MECHANISM = AddedBody(
    id="attached_mass",
    component="lower mass",
    summary="a small part on a stiff mount: accelerometer, cable, screw",
    source="tuned absorber",
    parameters=(
        Quantity(MASS, "kg", 0.0, LARGEST_KG, "mass of the part", log=True),
        Quantity(STIFFNESS, "N/m", 1e-3, 1e9, "stiffness of its mount", log=True),
        Quantity(DAMPING, "N s/m", 1e-9, 1e4, "damping of its mount", log=True),
    ),
    strength=MASS,
    trials=trials,
    extend=extend,
    at=every_body,
    on_body=True,
    body=(MASS, STIFFNESS, DAMPING),
    derived=(
        Derived("mount_frequency_hz", "Hz", frequency_hz, positive=True, meaning="resonance of the part on its mount"),
        Derived("mount_damping_ratio", "1", damping_ratio, positive=True, meaning="damping ratio of the mount"),
    ),
    statement=lambda values, name: (
        f"A part rides on the {name} on a mount that resonates at {frequency_hz(values):.0f} Hz."
    ),
)
