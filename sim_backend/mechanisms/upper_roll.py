"""The upper mass turns: the contact touches it off its axis, and no sensor sees that mass."""

from __future__ import annotations

import math
from dataclasses import replace

from sim_backend.arrangement import Arrangement, Element, Parameter
from sim_backend.mechanisms.kinds import AddedBody, Derived, Quantity, Scale, Values, geometric
from sim_backend.mechanisms.places import Place, preloaded_contact, unused_name

MASS, STIFFNESS, DAMPING = "roll_mass_kg", "roll_stiffness_n_per_m", "roll_damping_n_s_per_m"
NAMES = (MASS, STIFFNESS, DAMPING)
TRIAL_RATIO = 0.015
TRIAL_SHARE = 100.0  # of the body's mass: an offset of a tenth of its radius of gyration
LOWEST, HIGHEST = 1.5, 4.5  # resonances tried, from the lowest mode times this to the highest times this
TRIED = 32  # resonances
LEAST_KG, MOST_KG = 1e-3, 1e6


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Add the motion that turning makes at the contact, which the contact's force drives."""
    return beside_the_contact(rig, values, place, ("roll", "upper mass"), NAMES)


def beside_the_contact(
    rig: Arrangement, values: Values, place: Place, names: tuple[str, str], constants: tuple[str, str, str]
) -> Arrangement:
    """Add a body, named with its component, that moves one side of the contact against a spring of its own."""
    contact = rig.elements[place[0]]
    body = unused_name(names[0], rig.bodies)
    spring = unused_name(f"{names[0]} spring", [e.name for e in rig.elements])
    return rig.extended(
        bodies={body: constants[0]},
        changed={contact.name: replace(contact, row=(*contact.row, (body, 1.0)))},
        elements=(Element(spring, "body", names[1], ((body, 1.0),), constants[1], constants[2]),),
        parameters=tuple(
            Parameter(constant, unit, values[constant], positive=True)
            for constant, unit in zip(constants, ("kg", "N/m", "N s/m"), strict=True)
        ),
    )


def trials(scale: Scale) -> list[dict[str, float]]:
    """Return masses that hardly turn, with resonances from above the rig's lowest mode to above its highest."""
    mass = min(max(TRIAL_SHARE * scale.mass, LEAST_KG), MOST_KG)
    low = LOWEST * scale.frequency_hz[0]
    high = max(min(HIGHEST * scale.frequency_hz[1], scale.shown_hz), 2 * low)
    omegas = [2 * math.pi * f for f in geometric(low, high, TRIED)]
    return [{MASS: mass, STIFFNESS: mass * w**2, DAMPING: 2 * TRIAL_RATIO * mass * w} for w in omegas]


def quantities(of: str, names: tuple[str, str, str] = NAMES) -> tuple[Quantity, Quantity, Quantity]:
    """Return mass, stiffness and damping as the contact feels them."""
    return (
        Quantity(names[0], "kg", LEAST_KG, MOST_KG, f"{of} as the contact feels it", log=True),
        Quantity(names[1], "N/m", 1e-3, 1e16, "stiffness against it, as the contact feels it", log=True),
        Quantity(names[2], "N s/m", 1e-9, 1e11, "damping of it, as the contact feels it", log=True),
    )


def frequency_hz(values: Values) -> float:
    """Resonance of turning with the contact open, Hz."""
    return math.sqrt(values[STIFFNESS] / values[MASS]) / (2 * math.pi)


LIGHTNESS = Derived(
    "roll_lightness_per_kg",
    "1/kg",
    lambda values: 1 / values[MASS],
    positive=True,
    meaning="square of the offset over the inertia of turning",
)

MECHANISM = AddedBody(
    id="upper_roll",
    component="upper mass",
    summary="the upper mass turns, as the contact touches it off its axis",
    source="rigid body with an eccentric contact: inertia over the square of the offset",
    parameters=quantities("inertia of turning over the square of the offset,"),
    strength=None,
    trials=trials,
    extend=extend,
    at=preloaded_contact,
    body=NAMES,
    shaken=False,
    hidden=(
        "No sensor sees the upper mass: its turning shows as a mode of its own and as a little more compliance of the "
        "contact, just as a small part on a mount does, up to some hundred standard deviations. One answer stands for "
        "both. Two accelerometers on the upper mass tell them apart."
    ),
    same_as=("attached_mass",),
    derived=(Derived("roll_frequency_hz", "Hz", frequency_hz, positive=True, meaning="resonance of turning"),),
    limited=LIGHTNESS,
    statement=lambda values, name: (
        f"The upper mass turns as well as moves, as the {name} touches it off its axis: {values[MASS]:.3g} kg as felt "
        f"there, which resonate at {frequency_hz(values):.0f} Hz."
    ),
)
