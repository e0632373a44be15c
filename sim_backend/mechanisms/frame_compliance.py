"""A spring or joint stands on something that moves."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import cast

from sim_backend.arrangement import Arrangement, Element, Parameter
from sim_backend.mechanisms.kinds import AddedBody, Derived, Quantity, Scale, Values, geometric
from sim_backend.mechanisms.places import Place, grounded_elements, unused_name

MASS, STIFFNESS, DAMPING = "frame_mass_kg", "frame_stiffness_n_per_m", "frame_damping_n_s_per_m"
NAMES = (MASS, STIFFNESS, DAMPING)
TRIAL_RATIO = 0.02
TRIAL_SHARE = 1e4  # of the body's mass: a frame so heavy hardly moves
LOWEST, HIGHEST = 0.1, 4.5  # resonances tried, from the lowest mode times this to the highest times this
TRIED = 64  # resonances
LEAST_KG, MOST_KG = 1e-3, 1e5


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Put the foot of the element in the place on a body of its own."""
    return on_a_body(rig, values, place, "frame", NAMES)


def on_a_body(
    rig: Arrangement, values: Values, place: Place, name: str, constants: tuple[str, str, str]
) -> Arrangement:
    """Put the feet of all elements in a place on one more body, with these names of mass, stiffness and damping."""
    frame = unused_name(name, rig.bodies)
    footing = unused_name(f"{name}'s footing", [e.name for e in rig.elements])
    changed = {}
    for foot in (rig.elements[i] for i in place):
        carrier, share = foot.row[0][0], cast(float, foot.row[0][1])  # `grounded_elements` has no other coefficients
        changed[foot.name] = replace(foot, row=((carrier, share), (frame, -share)))
    return rig.extended(
        bodies={frame: constants[0]},
        changed=changed,
        elements=(Element(footing, "body", "frame", ((frame, 1.0),), constants[1], constants[2]),),
        parameters=tuple(
            Parameter(constant, unit, values[constant], positive=True)
            for constant, unit in zip(constants, ("kg", "N/m", "N s/m"), strict=True)
        ),
    )


def frequency_hz(values: Values) -> float:
    """Resonance of the frame on its footing, Hz."""
    return math.sqrt(values[STIFFNESS] / values[MASS]) / (2 * math.pi)


def trials(scale: Scale) -> list[dict[str, float]]:
    """Return frames so heavy that they hardly move, which resonate from below the rig's lowest mode to above all."""
    mass = min(max(TRIAL_SHARE * scale.mass, LEAST_KG), MOST_KG)
    low, high = scale.frequency_hz
    omegas = [2 * math.pi * f for f in geometric(LOWEST * low, max(min(HIGHEST * high, scale.shown_hz), low), TRIED)]
    return [{MASS: mass, STIFFNESS: mass * w**2, DAMPING: 2 * TRIAL_RATIO * mass * w} for w in omegas]


COMPLIANCE = Derived(
    "frame_compliance_m_per_n",
    "m/N",
    lambda values: 1 / values[STIFFNESS],
    positive=True,
    meaning="compliance below the frame",
)

MECHANISM = AddedBody(
    id="frame_compliance",
    component="frame",
    summary="a spring stands on something that moves",
    source="two-mass foundation model",
    parameters=(
        Quantity(MASS, "kg", LEAST_KG, MOST_KG, "mass that moves", log=True),
        Quantity(STIFFNESS, "N/m", 1e-3, 1e14, "stiffness below it", log=True),
        Quantity(DAMPING, "N s/m", 1e-9, 1e9, "damping below it", log=True),
    ),
    strength=None,
    trials=trials,
    extend=extend,
    at=lambda rig: grounded_elements(rig, ("spring", "joint", "contact", "pendulum")),
    body=NAMES,
    phase_locked=True,
    derived=(COMPLIANCE,),
    limited=COMPLIANCE,
    statement=lambda values, name: (
        f"The {name} stands on a frame that moves: {values[MASS]:.3g} kg that resonate at "
        f"{frequency_hz(values):.0f} Hz."
    ),
)
