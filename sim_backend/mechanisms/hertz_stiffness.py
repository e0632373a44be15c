"""The contact stiffens as Hertz says: force over approach to the power 3/2, about the preload."""

from __future__ import annotations

import math

from sim_backend.mechanisms.kinds import ForceLaw, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """P (1 + k d / (1.5 P))^1.5 in the place of P + k d; nothing beyond separation."""
    u = 1.0 + p[1] * d / (1.5 * p[0])
    elastic = p[0] * (u * math.sqrt(u) - 1.0) if u > 0.0 else -p[0]
    return force - p[1] * d + elastic


MECHANISM = ForceLaw(
    id="hertz_stiffness",
    component="contact",
    summary="force grows as approach^(3/2) about the preload",
    source="Hertz; Eq. 1 and 2",
    parameters=(),
    strength=None,
    trials=lambda scale: [{}],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    stiffness_exponent=(1 / 3, 0.03),
    statement=lambda values, name: (
        "The contact is stiffer when pressed and softer when released, as the force of a smooth sphere grows with the "
        "approach to the power 3/2 about the preload."
    ),
)
