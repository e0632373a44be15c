"""The tube springs have a mode of their own: part of each rides on its block as on a mount."""

from __future__ import annotations

import math

from sim_backend.arrangement import Arrangement, Element, Parameter
from sim_backend.mechanisms.kinds import AddedBody, Derived, Quantity, Scale, Values, geometric
from sim_backend.mechanisms.places import Place, grounded_elements, unused_name

MASS, STIFFNESS, DAMPING = "tube_mode_mass_kg", "tube_mode_stiffness_n_per_m", "tube_mode_damping_n_s_per_m"
TRIAL_RATIO = 0.02  # wider than such a mode is: the trials must not miss it between them
TRIAL_SHARE = 3e-4  # of the body's mass: too little to change its motion other than in proportion
LOWEST = 2.0  # of the highest mode: a spring whose wall rings nearer to it would not be called a spring
TRIED = 64  # resonances
LARGEST_KG = 1e3


def at(rig: Arrangement) -> list[Place]:
    """Return the springs between a body and the ground that are equal to another: one place for all of a group."""
    groups: dict[str, list[int]] = {}
    for (i,) in grounded_elements(rig, ("spring",)):
        alike = rig.elements[i].alike
        if alike is not None:
            groups.setdefault(alike, []).append(i)
    return [tuple(group) for group in groups.values() if len(group) > 1]


def mounted(rig: Arrangement, place: Place, names: tuple[str, str, str]) -> Arrangement:
    """Mount a body on the carrier of each spring in the place; all have the mass, stiffness and damping of one name."""
    mass, stiffness, damping = names
    for element in place:
        carrier = rig.elements[element].row[0][0]
        part = unused_name("tube", rig.bodies)
        wall = unused_name("tube's wall", [e.name for e in rig.elements])
        rig = rig.extended(
            bodies={part: mass},
            elements=(Element(wall, "body", "tube springs", ((part, 1.0), (carrier, -1.0)), stiffness, damping),),
        )
    return rig


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Give each spring in the place a part that rides on its carrier; all are equal."""
    return mounted(rig, place, (MASS, STIFFNESS, DAMPING)).extended(
        parameters=tuple(
            Parameter(name, unit, values[name], positive=True)
            for name, unit in ((MASS, "kg"), (STIFFNESS, "N/m"), (DAMPING, "N s/m"))
        )
    )


def frequency_hz(values: Values) -> float:
    """Resonance of a tube whose block is held, Hz."""
    return math.sqrt(values[STIFFNESS] / values[MASS]) / (2 * math.pi)


def damping_ratio(values: Values) -> float:
    """Damping of that resonance over critical."""
    return values[DAMPING] / 2 / math.sqrt(values[STIFFNESS] * values[MASS])


def trials(scale: Scale) -> list[dict[str, float]]:
    """Return light walls that resonate from above the rig's highest mode to what the channels show well."""
    mass = min(TRIAL_SHARE * scale.mass, LARGEST_KG)
    low = LOWEST * scale.frequency_hz[1]
    high = max(min(4 * low, scale.shown_hz), 1.5 * low)
    omegas = [2 * math.pi * f for f in geometric(low, high, TRIED)]
    return [{MASS: mass, STIFFNESS: mass * w**2, DAMPING: 2 * TRIAL_RATIO * mass * w} for w in omegas]


MECHANISM = AddedBody(
    id="tube_mode",
    component="tube springs",
    summary="the tube springs have a mode of their own",
    source="inextensional ring between two lines (Love), its first mode with the block held",
    parameters=(
        Quantity(MASS, "kg", 0.0, LARGEST_KG, "mass of each tube that rides", log=True),
        Quantity(STIFFNESS, "N/m", 1e-3, 1e9, "stiffness that it rides on", log=True),
        Quantity(DAMPING, "N s/m", 1e-9, 1e4, "damping of that", log=True),
    ),
    strength=MASS,
    trials=trials,
    extend=extend,
    at=at,
    body=(MASS, STIFFNESS, DAMPING),
    derived=(
        Derived(
            "tube_mode_frequency_hz", "Hz", frequency_hz, positive=True, meaning="resonance of the tubes themselves"
        ),
        Derived(
            "tube_mode_damping_ratio",
            "1",
            damping_ratio,
            positive=True,
            meaning="damping ratio of the tubes themselves",
        ),
    ),
    statement=lambda values, name: (
        f"The {name} resonate at {frequency_hz(values):.0f} Hz with {1e3 * values[MASS]:.2g} g each."
    ),
)
