"""A gap: beyond some deflection something else is touched, or let go."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

STIFFNESS, GAP = "stop_stiffness_n_per_m", "gap_m"


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """p[4] (d - p[5]) beyond p[5] (below it where p[5] is negative)."""
    beyond = max(d - p[5], 0.0) if p[5] >= 0.0 else min(d - p[5], 0.0)
    return force + p[4] * beyond


MECHANISM = ForceLaw(
    id="end_stop",
    component="contact",
    summary="stiffness that begins or ends at a deflection, on one side",
    source="bilinear stiffness: gap, stop, loss of contact",
    parameters=(
        Quantity(STIFFNESS, "N/m", -1e25, 1e25, "stiffness beyond the gap"),
        Quantity(GAP, "m", -1e25, 1e25, "deflection at which it begins; on the other side below zero"),
    ),
    strength=STIFFNESS,
    trials=lambda scale: [
        {STIFFNESS: 1e-3 * scale.force / scale.deformation, GAP: share * scale.deformation}
        for share in (-0.6, -0.3, 0.01, 0.3, 0.6)
    ],
    law=force_law,
    constants=lambda values, rest: (values[STIFFNESS], values[GAP]),
    one_signed=False,
    preloaded=False,
    fits=("contact", "spring", "guide"),  # a joint is what does not part
    statement=lambda values, name: (
        f"The {name} is another beyond a deflection of {values[GAP]:.4g}: from there on its stiffness "
        f"changes by {values[STIFFNESS]:+.4g}."
    ),
)
