"""The surfaces part when the dynamic force would pull them: a contact knows no tension."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """No less than minus the preload."""
    return max(force, -p[0])


MECHANISM = Mechanism(
    id="contact_loss",
    component="contact",
    acts="contact",
    summary="the interface cannot pull: it parts when the dynamic force exceeds the preload",
    source="unilateral contact",
    parameters=(),
    strength=None,
    trials=lambda scale: [{}],
    law=force_law,
    last=True,
    statement=lambda values: (
        "The surfaces part whenever the dynamic force would pull them by more than the preload; the interface carries "
        "no tension."
    ),
)
