"""A damping force of the squared rate: of a film that is squeezed, or of drag."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

SHARE, NAME = "quadratic_damping_per_c_c", "quadratic_damping_n_s2_per_m2"


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """q v abs(v)."""
    return force + p[4] * v * abs(v)


OF_CONTACT = ForceLaw(
    id="quadratic_damping",
    component="contact",
    summary="force of v abs(v)",
    source="turbulent or inertial squeeze of a film",
    parameters=(Quantity(SHARE, "s/m", 0.0, 1e9, "q over the contact's linear damping"),),
    strength=SHARE,
    trials=lambda scale: [{SHARE: 0.01 / scale.rate}],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (values[SHARE] * rest.damping,),
    statement=lambda values, name: f"The damping force of the {name} grows with the square of the rate of approach.",
)
DRAG = ForceLaw(
    id="quadratic_damping",
    component="contact",
    summary="force of v abs(v)",
    source="drag of a fluid at high Reynolds number",
    parameters=(Quantity(NAME, "N s2/m2", 0.0, 1e25, "coefficient of the squared speed"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 0.001 * scale.force / scale.rate**2}],
    law=force_law,
    fits=("damper", "pendulum", "guide", "spring", "joint", "contact"),
    preloaded=False,
    constants=lambda values, rest: (values[NAME],),
    statement=lambda values, name: (
        f"The {name} is held back by drag: {values[NAME]:.4g} times the squared speed, beside what linear damping "
        "there is."
    ),
)
MECHANISM = (OF_CONTACT, DRAG)
