"""Both tube springs stand on one base that moves: the plate that carries the tester, on its own feet."""

from __future__ import annotations

import math

from sim_backend.arrangement import Arrangement
from sim_backend.mechanisms import frame_compliance
from sim_backend.mechanisms.kinds import AddedBody, Derived, Quantity, Scale, Values
from sim_backend.mechanisms.places import Place, grounded_elements

MASS, STIFFNESS, DAMPING = "base_mass_kg", "base_stiffness_n_per_m", "base_damping_n_s_per_m"
NAMES = (MASS, STIFFNESS, DAMPING)


def at(rig: Arrangement) -> list[Place]:
    """Return the groups of equal elements that stand on the ground, two or more."""
    groups: dict[str, list[int]] = {}
    for (i,) in grounded_elements(rig, ("spring", "joint", "pendulum")):
        name = rig.elements[i].alike
        if name is not None:
            groups.setdefault(name, []).append(i)
    return [tuple(group) for group in groups.values() if len(group) > 1]


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Put the feet of all elements in the place on one body."""
    return frame_compliance.on_a_body(rig, values, place, "base", NAMES)


def trials(scale: Scale) -> list[dict[str, float]]:
    """Return bases so heavy that they hardly move; see `frame_compliance.trials`."""
    pairs = list(zip(NAMES, frame_compliance.NAMES, strict=True))
    return [{own: foot[of_foot] for own, of_foot in pairs} for foot in frame_compliance.trials(scale)]


def frequency_hz(values: Values) -> float:
    """Resonance of the base on its feet, Hz."""
    return math.sqrt(values[STIFFNESS] / values[MASS]) / (2 * math.pi)


COMPLIANCE = Derived(
    "base_compliance_m_per_n",
    "m/N",
    lambda values: 1 / values[STIFFNESS],
    positive=True,
    meaning="compliance below the base",
)

MECHANISM = AddedBody(
    id="base_motion",
    component="frame",
    summary="both springs stand on one base that moves",
    source="Den Hartog, Mechanical Vibrations: foundation of finite mass",
    parameters=(
        Quantity(MASS, "kg", frame_compliance.LEAST_KG, frame_compliance.MOST_KG, "mass that moves", log=True),
        Quantity(STIFFNESS, "N/m", 1e-3, 1e14, "stiffness below it", log=True),
        Quantity(DAMPING, "N s/m", 1e-9, 1e9, "damping below it", log=True),
    ),
    strength=None,
    trials=trials,
    extend=extend,
    at=at,
    body=NAMES,
    phase_locked=True,
    derived=(COMPLIANCE,),
    limited=COMPLIANCE,
    hidden=(
        "A base beneath both tubes is shaken by the mode in which both masses move together, as a foot beneath one of "
        "them is, and acts back on that mode as a foot of a quarter of its mass does: one answer stands for both. An "
        "accelerometer on the base, and one on each foot, tell them apart."
    ),
    same_as=("frame_compliance",),
    statement=lambda values, name: (
        f"The {name} stand on one base that moves: {values[MASS]:.3g} kg that resonate at "
        f"{frequency_hz(values):.0f} Hz."
    ),
)
