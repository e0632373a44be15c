"""A spring that stiffens or softens when it is deflected far, as the tube springs."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

NAME = "cubic_stiffness_n_per_m3"


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """k3 d^3."""
    return force + p[4] * d * d * d


MECHANISM = ForceLaw(
    id="tube_spring_cubic",
    component="tube springs",
    summary="a force of the cubed deflection",
    source="Duffing; large deflections of the rings",
    parameters=(Quantity(NAME, "N/m3", -1e25, 1e25, "coefficient of the cubed deflection"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 0.003 * scale.force / scale.deformation**3}],
    law=force_law,
    fits=("spring", "pendulum", "joint", "contact"),
    constants=lambda values, rest: (values[NAME],),
    one_signed=False,
    statement=lambda values, name: (
        f"With deflection the stiffness of the {name} {'grows' if values[NAME] > 0 else 'falls'}: a force of "
        f"{values[NAME]:.4g} N/m3 times the cubed deflection adds to that of the linear stiffness."
    ),
)
