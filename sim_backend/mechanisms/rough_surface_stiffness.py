"""The contact of rough surfaces stiffens in proportion to its load: an exponential force law."""

from __future__ import annotations

import math

from sim_backend.mechanisms.kinds import ForceLaw, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """P exp(k d / P) in the place of P + k d."""
    return force - p[1] * d + p[0] * math.expm1(min(p[1] * d / p[0], 50.0))


MECHANISM = ForceLaw(
    id="rough_surface_stiffness",
    component="contact",
    summary="force grows exponentially with approach, as of rough surfaces",
    source="Eq. 7 and 8; the Greenwood-Williamson family",
    parameters=(),
    strength=None,
    trials=lambda scale: [{}],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    stiffness_exponent=(0.95, 0.06),
    statement=lambda values, name: (
        "The contact's stiffness grows with the momentary force, as rough surfaces whose asperities come into contact "
        "one after the other: the force is exponential in the approach."
    ),
)
