"""Mechanisms that the simulated rig is given: what a diagnosis found, or what somebody wants to try."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from sim_backend.acting import Acting
from sim_backend.arrangement import tester
from sim_backend.mechanisms.catalogue import family, placed
from sim_backend.mechanisms.kinds import Mechanism, Scale, SecondImpact, Tones

# only to ask a mechanism where it acts and which values it needs
ANY_SCALE = Scale(1e-8, 1e-4, 1e-7, 0.1, (350.0, 2000.0))
ANY_RIG = tester(0.107, 0.108, 5e5, 5e5, 1e7, 1.0, mass_uncertainty=0.0, spring_uncertainty=0.0)
WHOLE_SESSION = "of_session"  # a value that a single tap cannot know


def adopted(
    mechanism_id: str, parameters: Mapping[str, float], folders: Sequence[str | Path] = (), at: str | None = None
) -> Acting:
    """Check a mechanism's name and values.

    Parameters
    ----------
    parameters
        Its parameters, and whatever else stays fixed in it; of the latter the usual value is taken where it is left
        out. Quantities that follow from a parameter may stand beside it. Of several variants, the one that has these
        parameters is meant.
    folders
        Of a user's own mechanisms.
    at
        Name of the body or element that it acts on; the first that it can act on where it is left out.

    Raises
    ------
    ValueError
        A sentence: no such mechanism, none that acts in a ring-down or there, or a parameter that is missing, unknown
        or out of its range.
    """
    known = family(mechanism_id, folders)
    if known is None:
        raise ValueError(f"unknown mechanism {mechanism_id!r}; 'mesotap mechanisms' lists the known ones")
    acting = placed(known, ANY_RIG)
    if not acting:
        raise ValueError(f"{mechanism_id} does not act in a ring-down, so it cannot be simulated in one")
    if at is not None:
        named = [(m.named(ANY_RIG, place), m, place) for m, place in acting]
        acting = [(m, place) for name, m, place in named if name == at]
        if not acting:
            where = ", ".join(dict.fromkeys(name for name, *_ in named))
            raise ValueError(f"{mechanism_id} cannot act at {at!r}, only at: {where}")
    meant = [(m, place) for m, place in acting if {q.name for q in m.parameters} <= set(parameters)]
    mechanism, place = (meant or acting)[0]
    return Acting(mechanism, _checked(mechanism, parameters), place)


def _checked(mechanism: Mechanism, parameters: Mapping[str, float]) -> dict[str, float]:
    trials = mechanism.trials(ANY_SCALE)
    quantities = {q.name: q for q in mechanism.parameters}
    fixed = {k: v for k, v in (trials[0] if trials else {}).items() if k not in quantities and k != WHOLE_SESSION}
    ignored = {WHOLE_SESSION, *(d.name for d in mechanism.derived)}
    if unknown := [k for k in parameters if k not in quantities and k not in fixed and k not in ignored]:
        allowed = ", ".join((*quantities, *fixed)) or "none"
        raise ValueError(f"{mechanism.id} has no parameter {unknown[0]!r}; it has {allowed}")
    for name, q in quantities.items():
        if name not in parameters:
            raise ValueError(f"{mechanism.id} needs {name} ({q.meaning}, {q.unit})")
        if not q.low <= parameters[name] <= q.high:
            raise ValueError(f"{mechanism.id}: {name} is {parameters[name]:g}, allowed are {q.low:g} to {q.high:g}")
    return fixed | {k: v for k, v in parameters.items() if k not in ignored}


def second_impact(found: Sequence[Acting]) -> float | None:
    """Return the share of the first impulse that a second impact has; None without one."""
    return next(
        (a.values[a.mechanism.parameters[0].name] for a in found if isinstance(a.mechanism, SecondImpact)), None
    )


def tones(found: Sequence[Acting]) -> list[tuple[float, float]]:
    """Return frequency, Hz, and amplitude, m/s2, of the steady tones in the channels: all as loud as the loudest."""
    return [
        (hz, a.values[a.mechanism.parameters[0].name])
        for a in found
        if isinstance(a.mechanism, Tones)
        for hz in a.mechanism.lines(a.values)
    ]
