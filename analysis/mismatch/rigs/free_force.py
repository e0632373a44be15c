"""The competitor that names nothing: a force of any smooth shape in an element."""

from __future__ import annotations

import math

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, law

TERMS = ("d2", "d3", "d5", "a_d", "a_v", "d_v", "v_v", "v3", "d2_v", "sign_v", "t_d", "t_v")
FIXED = ("deformation", "rate", "duration")


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Twelve shapes of deformation u, rate w, momentary amplitude a and time, over their scales p[16] to p[18]."""
    u, w, s = d / p[16], v / p[17], t / p[18]
    a = math.sqrt(u * u + w * w)
    total = p[4] * u * u + p[5] * u * u * u + p[6] * u * u * u * u * u + p[7] * a * u + p[8] * a * w + p[9] * u * w
    total += p[10] * w * abs(w) + p[11] * w * w * w + p[12] * u * u * w + p[13] * math.tanh(20.0 * w)
    return force + total + p[14] * s * u + p[15] * s * w


FREE_FORCE = Mechanism(
    id="free_force",
    component="contact",
    summary="a force of any smooth shape",
    source="restoring force surface",
    parameters=tuple(Quantity(name, "N", -1e25, 1e25, "share of this shape") for name in TERMS),
    strength=None,
    trials=lambda scale: [
        dict.fromkeys(TERMS, 0.0001 * scale.force)
        | {"deformation": scale.deformation, "rate": scale.rate, "duration": scale.duration_s}
    ],
    law=force_law,
    constants=lambda values, rest: tuple(values[name] for name in (*TERMS, *FIXED)),
    one_signed=False,
    statement=lambda values: "",
)
