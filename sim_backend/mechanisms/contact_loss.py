"""The surfaces part when the dynamic force would pull them: a contact knows no tension."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """No less than minus the preload."""
    return max(force, -p[0])


MECHANISM = ForceLaw(
    id="contact_loss",
    component="contact",
    summary="the interface cannot pull: it parts when the dynamic force exceeds the preload",
    source="unilateral contact",
    parameters=(),
    strength=None,
    trials=lambda scale: [{}],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    last=True,
    statement=lambda values, name: (
        "The surfaces part whenever the dynamic force would pull them by more than the preload; the interface carries "
        "no tension."
    ),
)
