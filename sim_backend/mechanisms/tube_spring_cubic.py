"""The tube springs stiffen when they are bent far."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """k3 d^3."""
    return force + p[4] * d * d * d


MECHANISM = Mechanism(
    id="tube_spring_cubic",
    component="tube springs",
    acts="spring",
    summary="large-deflection stiffness of the ring",
    source="Duffing",
    parameters=(Quantity("cubic_stiffness_n_per_m3", "N/m3", -1e25, 1e25, "coefficient of the cubed deflection"),),
    strength="cubic_stiffness_n_per_m3",
    trials=lambda scale: [{"cubic_stiffness_n_per_m3": 0.003 * scale.force / scale.deformation**3}],
    law=force_law,
    constants=lambda values, rest: (values["cubic_stiffness_n_per_m3"],),
    one_signed=False,
    statement=lambda values: (
        f"The tube springs are not linear: a force of {values['cubic_stiffness_n_per_m3']:.3g} N/m3 times the cubed "
        "deflection adds to theirs."
    ),
)
