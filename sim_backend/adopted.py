"""Mechanisms that the simulated rig is given: what a diagnosis found, or what somebody wants to try."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sim_backend.mechanisms.mechanism import Mechanism, Scale, mechanisms

ANY_SCALE = Scale(1e-8, 1e-4, 1e-7, 0.1, (350.0, 2000.0))  # only to ask a mechanism which values it needs
WHOLE_SESSION = "of_session"  # a value that a single tap cannot know


@dataclass(frozen=True, slots=True)
class Adopted:
    """A mechanism with the values that it acts with."""

    mechanism: Mechanism
    values: Mapping[str, float]


def adopted(mechanism_id: str, parameters: Mapping[str, float]) -> Adopted:
    """Check a mechanism's name and values.

    Parameters
    ----------
    parameters
        Its parameters, and whatever else stays fixed in it; of the latter the usual value is taken where it is left
        out. Quantities that follow from a parameter may stand beside it.

    Raises
    ------
    ValueError
        A sentence: no such mechanism, none that acts in a ring-down, or a parameter that is missing, unknown or out of
        its range.
    """
    known = mechanisms()
    if mechanism_id not in known:
        raise ValueError(f"{mechanism_id!r} is no mechanism; mesotap mechanisms lists them")
    mechanism = known[mechanism_id]
    acts = mechanism.law or mechanism.extend or mechanism.distort or mechanism.lines or mechanism.blow
    if not acts:
        raise ValueError(f"{mechanism_id} does not act in a ring-down, so it cannot be simulated in one")
    trials = mechanism.trials(ANY_SCALE)
    quantities = {q.name: q for q in mechanism.parameters}
    fixed = {k: v for k, v in (trials[0] if trials else {}).items() if k not in quantities and k != WHOLE_SESSION}
    ignored = {WHOLE_SESSION, *(d.name for d in mechanism.derived)}
    if unknown := [k for k in parameters if k not in quantities and k not in fixed and k not in ignored]:
        allowed = ", ".join((*quantities, *fixed)) or "none"
        raise ValueError(f"{mechanism_id} has no parameter {unknown[0]!r}; it has {allowed}")
    for name, q in quantities.items():
        if name not in parameters:
            raise ValueError(f"{mechanism_id} needs {name} ({q.meaning}, {q.unit})")
        if not q.low <= parameters[name] <= q.high:
            raise ValueError(f"{mechanism_id}: {name} is {parameters[name]:g}, allowed are {q.low:g} to {q.high:g}")
    return Adopted(mechanism, fixed | {k: v for k, v in parameters.items() if k not in ignored})


def second_blow(found: Sequence[Adopted]) -> float | None:
    """Return the share of the first impulse that a second blow has; None without one."""
    return next((next(iter(a.values.values())) for a in found if a.mechanism.blow), None)


def tones(found: Sequence[Adopted]) -> list[tuple[float, float]]:
    """Return frequency, Hz, and amplitude, m/s2, of the steady tones in the channels: all as loud as the loudest."""
    return [
        (hz, a.values[a.mechanism.parameters[0].name])
        for a in found
        if a.mechanism.lines is not None
        for hz in a.mechanism.lines(a.values)
    ]
