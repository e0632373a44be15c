"""The competitor that names nothing: forces of any shape in contact and springs, and any small change of a channel.

A few dozen terms span what a force can depend on (deformation, its rate, momentary amplitude, time since the tap).
Where they take away much that the best named mechanism leaves, something else is at work.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, Real, Scale, Values

NAME = "strength"
SHARE = 1e-4  # of the element's force: small enough for a first-order effect
SHARP = 10.0  # steepness of a rounded step

Shape = Callable[[Real, Real, Real, Real], Real]
"""Of deformation and rate (over their scales), momentary amplitude and time (s)."""

CONTACT: dict[str, Shape] = {
    "d2": lambda u, w, a, t: u * u,
    "d3": lambda u, w, a, t: u**3,
    "abs_d_d": lambda u, w, a, t: np.abs(u) * u,
    "abs_d": lambda u, w, a, t: np.abs(u),
    "d_v": lambda u, w, a, t: u * w,
    "v2": lambda u, w, a, t: w * w,
    "d2_v": lambda u, w, a, t: u * u * w,
    "d_v2": lambda u, w, a, t: u * w * w,
    "abs_v_v": lambda u, w, a, t: np.abs(w) * w,
    "v3": lambda u, w, a, t: w**3,
    "sign_v": lambda u, w, a, t: np.tanh(SHARP * w),
    "a_d": lambda u, w, a, t: a * u,
    "a_v": lambda u, w, a, t: a * w,
    "a2_d": lambda u, w, a, t: a * a * u,
    "a2_v": lambda u, w, a, t: a * a * w,
    "d_small": lambda u, w, a, t: u / (1 + SHARP * a),
    "v_small": lambda u, w, a, t: w / (1 + SHARP * a),
    "d_early": lambda u, w, a, t: u * np.exp(-t / 3e-3),
    "v_early": lambda u, w, a, t: w * np.exp(-t / 3e-3),
    "d_late": lambda u, w, a, t: u * np.exp(-t / 2e-2),
    "v_late": lambda u, w, a, t: w * np.exp(-t / 2e-2),
}
SPRING: dict[str, Shape] = {
    "v": lambda u, w, a, t: w,
    "d2": lambda u, w, a, t: u * u,
    "d3": lambda u, w, a, t: u**3,
    "abs_v_v": lambda u, w, a, t: np.abs(w) * w,
    "sign_v": lambda u, w, a, t: np.tanh(SHARP * w),
    "a_d": lambda u, w, a, t: a * u,
}


def _force(role: str, name: str, shape: Shape) -> Mechanism:
    def along(d: Real, v: Real, t: Real, values: Values) -> Real:
        u, w = d / values["deformation"], v / values["rate"]
        return SHARE * values["force"] * shape(u, w, np.hypot(u, w), t)

    def trials(scale: Scale) -> list[dict[str, float]]:
        return [{NAME: 1.0, "deformation": scale.deformation, "rate": scale.rate, "force": scale.force}]

    return Mechanism(
        id=f"free_{role}_{name}",
        component="contact" if role == "contact" else "tube springs",
        acts=role,  # type: ignore[arg-type]
        summary="a force of any shape",
        source="free form",
        parameters=(Quantity(NAME, "1", -1e9, 1e9, "strength"),),
        strength=NAME,
        trials=trials,
        shape=along,
        one_signed=False,
        statement=lambda values: "",
    )


def _channel(number: int, power: int) -> Mechanism:
    def distort(y: Real, values: Values, sample_rate_hz: float) -> Real:
        out = y.copy()
        if power:
            out[number] += (
                values[NAME] * SHARE * y[number] ** power / max(float(np.abs(y).max()), 1e-300) ** (power - 1)
            )
        else:
            out[number, 1:] += values[NAME] * SHARE * np.diff(y[number])
        return out

    return Mechanism(
        id=f"free_channel_{number}_{power}",
        component="sensor chain",
        summary="a change of one channel",
        source="free form",
        parameters=(Quantity(NAME, "1", -1e9, 1e9, "strength"),),
        strength=NAME,
        trials=lambda scale: [{NAME: 1.0}],
        distort=distort,
        one_signed=False,
        statement=lambda values: "",
    )


def free_terms(channels: int) -> list[Mechanism]:
    """Return the terms of the competitor for rigs with so many channels."""
    found = [_force("contact", name, shape) for name, shape in CONTACT.items()]
    found += [_force("spring", name, shape) for name, shape in SPRING.items()]
    found += [_force("guide", name, shape) for name, shape in SPRING.items()]
    if channels > 1:
        found += [_channel(channels - 1, power) for power in (0, 1)]
        found += [_channel(c, power) for c in range(channels) for power in (2, 3)]
    return found
