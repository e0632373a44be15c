"""Contact damping as the square of the rate of approach."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """q v abs(v)."""
    return force + p[4] * v * abs(v)


MECHANISM = Mechanism(
    id="quadratic_damping",
    component="contact",
    acts="contact",
    summary="force of v abs(v)",
    source="turbulent or inertial squeeze of a film",
    parameters=(Quantity("quadratic_damping_per_c_c", "s/m", 0.0, 1e9, "q over the contact's linear damping"),),
    strength="quadratic_damping_per_c_c",
    trials=lambda scale: [{"quadratic_damping_per_c_c": 0.01 / scale.rate}],
    law=force_law,
    constants=lambda values, rest: (values["quadratic_damping_per_c_c"] * rest.damping,),
    statement=lambda values: "The contact's damping force grows with the square of the rate of approach.",
)
