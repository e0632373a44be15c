"""A spring that is stiffer one way than the other."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

NAME = "quadratic_stiffness_n_per_m2"


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """k2 d^2."""
    return force + p[4] * d * d


MECHANISM = ForceLaw(
    id="spring_asymmetry",
    component="tube springs",
    summary="a force of the squared deflection",
    source="Helmholtz oscillator",
    parameters=(Quantity(NAME, "N/m2", -1e25, 1e25, "coefficient of the squared deflection"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 0.003 * scale.force / scale.deformation**2}],
    law=force_law,
    constants=lambda values, rest: (values[NAME],),
    one_signed=False,
    fits=("spring", "contact", "joint", "pendulum"),
    statement=lambda values, name: (
        f"The {name} is stiffer one way than the other: a force of {values[NAME]:.4g} times the squared "
        "deflection adds to that of its linear stiffness."
    ),
)
