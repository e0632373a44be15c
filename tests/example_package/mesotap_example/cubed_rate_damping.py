"""Damping that grows with the cube of the speed: a mechanism of one's own, as docs/mechanisms.md explains it."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

NAME = "cubed_rate_damping_n_s3_per_m3"


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """q v^3 with p[4] = q, added to the force so far; p[0] to p[3] are preload, stiffness, damping and time step."""
    return force + p[4] * v * v * v


MECHANISM = ForceLaw(
    id="cubed_rate_damping",
    component="contact",
    summary="force of the cubed speed",
    source="shear thickening of a film",
    parameters=(Quantity(NAME, "N s3/m3", 0.0, 1e25, "coefficient of the cubed speed"),),
    strength=NAME,
    # so little that the effect is proportional to it: a thousandth of the element's force
    trials=lambda scale: [{NAME: 1e-3 * scale.force / scale.rate**3}],
    law=force_law,
    constants=lambda values, rest: (values[NAME],),
    fits=("contact", "joint", "damper", "spring", "guide"),
    statement=lambda values, name: (
        f"The damping of the {name} grows with the speed: {values[NAME]:.3g} times its cube adds to the force."
    ),
)
