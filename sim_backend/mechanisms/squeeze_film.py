"""A lubricant film between the surfaces: viscous force that rises as the gap closes."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """c_f (h / (h - d))^3 v less its value at rest, which is part of c_c; p[4] = c_f, p[5] = h."""
    gap = max(1.0 - d / p[5], 0.05)
    return force + p[4] * (1.0 / gap**3 - 1.0) * v


MECHANISM = ForceLaw(
    id="squeeze_film",
    component="contact",
    summary="lubricant film: viscous force rising as the gap closes",
    source="Reynolds: squeeze film damping over the cube of the gap",
    parameters=(
        Quantity("film_share_of_c_c", "1", 0.0, 1.0, "share of c_c that is the film's at rest"),
        Quantity("film_height_m", "m", 1e-9, 0.1, "gap at rest", log=True),
    ),
    strength="film_share_of_c_c",
    trials=lambda scale: [
        {"film_share_of_c_c": 0.01, "film_height_m": scale.deformation * r} for r in (2.0, 5.0, 20.0)
    ],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (
        values["film_share_of_c_c"] * rest.damping,
        values["film_height_m"],
    ),
    statement=lambda values, name: (
        f"A film of about {1e9 * values['film_height_m']:.0f} nm between the surfaces resists their approach the more, "
        "the closer they are."
    ),
)
