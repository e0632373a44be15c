"""Mechanisms at work in a rig: where, with which values, and what they make of its description."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AddedBody, ForceLaw, Mechanism
from sim_backend.mechanisms.places import Place


@dataclass(frozen=True, slots=True)
class Acting:
    """A mechanism at work in a place, with values of its parameters and of what stays fixed in it."""

    mechanism: Mechanism
    values: Mapping[str, float]
    place: Place = ()


def extended(rig: Arrangement, acting: Iterable[Acting]) -> Arrangement:
    """Return a rig with the bodies and elements that mechanisms add."""
    for one in acting:
        if isinstance(one.mechanism, AddedBody):
            rig = one.mechanism.extend(rig, one.values, one.place)
    return rig


def shaken(rig: Arrangement, acting: Iterable[Acting]) -> Real:
    """Return (bodies,) one for each added body that an acceleration of the base shakes as it does the rig's own."""
    found = [0.0] * len(rig.bodies)
    for one in acting:
        rig = extended(rig, [one])
        pushed = isinstance(one.mechanism, AddedBody) and one.mechanism.shaken
        found += [float(pushed)] * (len(rig.bodies) - len(found))
    return np.array(found)


def laws_in(acting: Sequence[Acting]) -> list[tuple[int, ForceLaw, int]]:
    """Return number, law and element of every force law at work; those that must be last in an element last."""
    found = [(i, a.mechanism, e) for i, a in enumerate(acting) if isinstance(a.mechanism, ForceLaw) for e in a.place]
    return sorted(found, key=lambda one: one[1].last)
