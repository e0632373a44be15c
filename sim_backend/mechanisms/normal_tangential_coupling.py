"""A contact that is not square to the axis moves a mass sideways, whose lateral mode then acts back on it."""

from __future__ import annotations

from sim_backend.arrangement import Arrangement
from sim_backend.mechanisms import upper_roll
from sim_backend.mechanisms.kinds import AddedBody, Values
from sim_backend.mechanisms.places import Place, preloaded_contact

NAMES = ("lateral_mass_kg", "lateral_stiffness_n_per_m", "lateral_damping_n_s_per_m")


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Add the lateral motion as the contact feels it."""
    return upper_roll.beside_the_contact(rig, values, place, ("lateral motion", "contact"), NAMES)


MECHANISM = AddedBody(
    id="normal_tangential_coupling",
    component="contact",
    summary="an inclined contact moves a mass sideways, which acts back on it",
    source="Adams, J. Tribol. 118 (1996) 819: coupled normal and tangential motion",
    parameters=upper_roll.quantities("lateral mass over the square of the inclination,", NAMES),
    strength=None,
    trials=lambda scale: [
        dict(zip(NAMES, (roll[name] for name in upper_roll.NAMES), strict=True)) for roll in upper_roll.trials(scale)
    ],
    extend=extend,
    at=preloaded_contact,
    body=NAMES,
    shaken=False,
    hidden=(
        "Sensors along the axis see a lateral mode only by what it does to the contact, as they do a turning of the "
        "upper mass or a small part on a mount: one answer stands for all. An accelerometer across the axis tells it."
    ),
    same_as=("attached_mass",),
    statement=lambda values, name: (
        f"The {name} is inclined and moves a mass sideways: {values[NAMES[0]]:.3g} kg as felt along the axis."
    ),
)
