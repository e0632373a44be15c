"""Offsets that no recording tells: a rig at rest elsewhere, with its sensors read from there, shows the same.

An offset of an input moves the place at which the rig rests. Where no law and no channel depends on that place, the
motion about it is the same, exactly; a gap counts from there. Slopes by differences do not show this: beside a force
that jumps they are off by some percent, which is much more than noise, and make a direction that nothing tells seem
told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.rig_description import DescribedRig
from sim_backend.acting import laws_in
from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Real
from sim_backend.force_law import DAMPING, MEMORY, STIFFNESS, along
from sim_backend.mechanisms.kinds import AtRest, ChannelDistortion, ForceLaw

Values = Mapping[str, float]

SINGULAR: Final = 1e9  # condition of a stiffness matrix that says nothing of where the rig rests
NOTHING: Final = 1e-9  # share below which a difference is rounding
SHIFTS: Final = tuple(10.0**k for k in range(-9, 4))  # m, of a law's place of rest: what stops and gaps may be wide
MOTION: Final = (1e-6, 1e-3, 1.0)  # amplitudes (m, and m/s) of the motion along which a law is looked at
POINTS: Final = 24


def untold_offsets(
    rig: DescribedRig, arrangement: Arrangement, constants: Values, terms: Sequence[Term], pushed: Sequence[Real]
) -> set[str]:
    """Return the offsets of inputs that nothing tells, and those of sensors that change with them.

    Parameters
    ----------
    rig, arrangement
        As described, and with the bodies of terms.
    constants
        Of all elements.
    terms
        Mechanisms at work.
    pushed
        (n,) forces on the bodies by a unit of each input.
    """
    free = {p.name for p in arrangement.parameters if p.uncertainty != 0.0}
    stiffness = arrangement.matrices(constants)[2]
    if not np.all(np.isfinite(stiffness)) or np.linalg.cond(stiffness) > SINGULAR:
        return set()
    found: set[str] = set()
    for number, (drive, force) in enumerate(zip(rig.drives, pushed, strict=True)):
        if drive.offset not in free or not force.any() or _distorted(terms, number):
            continue
        moved = np.asarray(np.linalg.solve(stiffness, force), np.float64)
        shown = [
            seen.offset
            for seen, sensor in zip(rig.seen, arrangement.sensors, strict=True)
            if sensor.quantity == "displacement" and _differs(arrangement.vector(sensor.row, constants), moved)
        ]
        if free.issuperset(shown) and not _laws_see(moved, rig, arrangement, constants, terms):
            found |= {drive.offset, *shown}
    return found


def _distorted(terms: Sequence[Term], number: int) -> bool:
    """Whether what an input is in truth depends on its offset in more than one way."""
    channels = [t for t in terms if isinstance(t.mechanism, ChannelDistortion) and t.mechanism.of == "input"]
    return any(number in t.place for t in channels)


def _differs(row: Real, moved: Real) -> bool:
    return bool(abs(row @ moved) > NOTHING * np.linalg.norm(row) * np.linalg.norm(moved))


def _laws_see(
    moved: Real, rig: DescribedRig, arrangement: Arrangement, constants: Values, terms: Sequence[Term]
) -> bool:
    """Whether a law acts in an element that rests elsewhere, and depends on it."""
    for i, mechanism, e in laws_in(terms):
        element = arrangement.elements[e]
        if _differs(arrangement.vector(element.row, constants), moved):
            rest = AtRest.of(element, constants, rig.preload_n)
            if _depends(mechanism, tuple(sorted(terms[i].values.items())), rest):
                return True
    return False


@lru_cache(maxsize=4096)  # fits and screenings ask the same of the same terms hundreds of times
def _depends(mechanism: ForceLaw, values: tuple[tuple[str, float], ...], rest: AtRest) -> bool:
    return depends_on_place(mechanism, dict(values), rest)


def depends_on_place(mechanism: ForceLaw, values: Values, rest: AtRest) -> bool:
    """Whether the force of a law is another one where the element rests elsewhere, whatever its own lengths are.

    A stop that is moved with the place at which the rig rests is the same stop: its gap counts from there.

    Examples
    --------
    >>> from sim_backend.mechanisms.catalogue import family
    >>> (friction,) = family("guide_friction")
    >>> depends_on_place(friction, {"friction_force_n": 2.0, "rounding": 1e-4}, AtRest())
    False
    """
    lengths = [q.name for q in mechanism.parameters if q.unit == "m" and values[q.name]]
    return all(_seen(mechanism, values, rest, name) for name in ("", *lengths))


def _seen(mechanism: ForceLaw, values: Values, rest: AtRest, length: str) -> bool:
    """Whether a law sees that its element rests elsewhere, one of its lengths counted from there."""
    angle, h = 2 * np.pi * np.arange(POINTS) / POINTS, 1.0 / POINTS
    shifts = np.array([sign * shift for shift in SHIFTS for sign in (1.0, -1.0)])
    if length:  # which side a length is on is part of the law
        shifts = shifts[np.abs(shifts) < abs(values[length])]
    p, memory = mechanism.packed(values, rest, h), np.zeros(MEMORY)
    for size in MOTION:
        d, v = size * np.sin(angle), size * np.cos(angle)
        (here,) = along(mechanism.law, p[None], d, v, 0.0, h, memory)
        for shift in shifts:
            own = p if not length else mechanism.packed({**values, length: values[length] + shift}, rest, h)
            (there,) = along(mechanism.law, own[None], d + shift, v, 0.0, h, memory)
            linear = abs(p[STIFFNESS]) * (abs(shift) + size) + abs(p[DAMPING]) * size  # is added, and taken off again
            if not np.abs(there - here).max() <= NOTHING * (np.abs(here).max() + linear):
                return True
    return False
