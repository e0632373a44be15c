"""What holds a specimen yields: a spring in series with the contact, between the block and the specimen."""

from __future__ import annotations

import math
from dataclasses import replace

from sim_backend.arrangement import Arrangement, Element, Parameter
from sim_backend.mechanisms.kinds import AddedBody, Derived, Quantity, Values
from sim_backend.mechanisms.places import Place, preloaded_contact, unused_name

MASS, STIFFNESS, DAMPING = "specimen_mass_kg", "holder_stiffness_n_per_m", "holder_damping_n_s_per_m"


def extend(rig: Arrangement, values: Values, place: Place) -> Arrangement:
    """Put the specimen, a body of its own, between the contact and the block that holds it."""
    contact = rig.elements[place[0]]
    *others, (block, share) = contact.row
    specimen = unused_name("specimen", rig.bodies)
    holder = unused_name("holder", [e.name for e in rig.elements])
    return rig.extended(
        bodies={specimen: MASS},
        changed={contact.name: replace(contact, row=(*others, (specimen, share)))},
        elements=(Element(holder, "body", "contact", ((specimen, 1.0), (block, -1.0)), STIFFNESS, DAMPING),),
        parameters=tuple(
            Parameter(name, unit, values[name], positive=True)
            for name, unit in ((MASS, "kg"), (STIFFNESS, "N/m"), (DAMPING, "N s/m"))
        ),
    )


def frequency_hz(values: Values) -> float:
    """Resonance of the specimen on its holder, Hz."""
    return math.sqrt(values[STIFFNESS] / values[MASS]) / (2 * math.pi)


MECHANISM = AddedBody(
    id="holder_compliance",
    component="contact",
    summary="the holder yields between block and specimen, in series with the contact",
    source="springs in series; Johnson, Contact Mechanics, ch. 4: compliance of the frame",
    parameters=(
        Quantity(MASS, "kg", 1e-7, 1.0, "mass of the specimen", log=True),
        Quantity(STIFFNESS, "N/m", 1e2, 1e13, "stiffness between specimen and block", log=True),
        Quantity(DAMPING, "N s/m", 1e-9, 1e7, "damping between them", log=True),
    ),
    strength=None,
    trials=lambda scale: [{MASS: 1e-3, STIFFNESS: 5e7, DAMPING: 1.0}],
    extend=extend,
    at=preloaded_contact,
    body=(MASS, STIFFNESS, DAMPING),
    derived=(
        Derived(
            "holder_compliance_m_per_n",
            "m/N",
            lambda values: 1 / values[STIFFNESS],
            positive=True,
            meaning="compliance of the holder",
        ),
        Derived(
            "holder_frequency_hz", "Hz", frequency_hz, positive=True, meaning="resonance of the specimen on its holder"
        ),
    ),
    hidden=(
        "At one load a spring in series with the contact is part of k_c and its losses are part of c_c, as long as the "
        "specimen resonates on it far above the contact mode. Several loads tell it: 1/k_c is the contact's "
        "compliance, which falls as the load grows, plus the holder's, which stays. So does a specimen that is glued "
        "in the place of the contact."
    ),
    statement=lambda values, name: (
        f"The holder yields in series with the {name}: {values[STIFFNESS]:.3g} N/m between specimen and block."
    ),
)
