"""Linear damping where the rig is said to have none of its own."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, law

NAME = "c_n_s_per_m"


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """c v."""
    return force + p[4] * v


MECHANISM = Mechanism(
    id="tube_spring_damping",
    component="tube springs",
    summary="linear damping where the rig is said to have none of its own",
    source="Kelvin and Voigt",
    parameters=(Quantity(NAME, "N s/m", 0.0, 1e25, "damper beside the element"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-4 * scale.force / scale.rate}],
    law=force_law,
    constants=lambda values, rest: (values[NAME],),
    fits=("spring", "joint", "contact", "guide", "pendulum"),
    statement=lambda values: f"The {{element}} dissipates as with a damper of {values[NAME]:.3g} beside it.",
)
