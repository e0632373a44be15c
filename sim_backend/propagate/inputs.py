"""What an integration is of: rigs, force laws in their elements, given inputs, a second impact, a time axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sim_backend.arrays import Real, Whole
from sim_backend.force_law import REST, SLOTS, compiled_law, no_law


class Rigs(NamedTuple):
    """Linear rigs, one for each run.

    ``mass`` (runs, n) kg; ``damping`` and ``stiffness`` (runs, n, n) N s/m and N/m; ``rows`` (runs, elements, n)
    deformation of each element for unit displacements; ``inputs`` (runs, n, u) force on the bodies by a unit of each
    input.
    """

    mass: Real
    damping: Real
    stiffness: Real
    rows: Real
    inputs: Real


class Laws(NamedTuple):
    """`SLOTS` force laws, the element each acts in (-1: none), and their parameters (runs, SLOTS, any).

    Those of one element follow each other, and each takes the force that the one before leaves; those that are none
    come last. ``jumps`` (SLOTS,) is 1 where the force jumps with the speed, and so may hold a body where it is.
    """

    law: tuple[Any, ...]
    element: Whole
    parameters: Real
    jumps: Whole


class Given(NamedTuple):
    """Inputs over each step, ``start + (end - start) u + bend u (u - 1)`` for u from 0 to 1.

    ``start``, ``end`` and ``bend`` are (runs or 1, u, k); the k-th is for ``held`` steps, 1 unless it is a constant.
    """

    start: Real
    end: Real
    bend: Real
    held: int


class Impact(NamedTuple):
    """A second impact: the step after which each run's state jumps, (runs,) with -1 for never, and by how much.

    ``jump`` is (runs, 2 n), m and m/s.
    """

    step: Whole
    jump: Real


class Clock(NamedTuple):
    """Time since the tap at the start of each run (runs,), s; the step, s, negative to go back; how many steps.

    States are returned after every ``sampled`` steps, none for 0.
    """

    start: Real
    step: float
    steps: int
    sampled: int


def laws_of(slots: Sequence[tuple[Any, int]], parameters: Sequence[Sequence[Real]], jumps: Sequence[bool] = ()) -> Laws:
    """Pack laws with their elements, (runs, slots) rows of parameters, and whether their forces jump (none does).

    Raises
    ------
    ValueError
        More laws than can act together.
    """
    if len(slots) > SLOTS:
        raise ValueError(f"no more than {SLOTS} force laws can act together")
    order = sorted(range(len(slots)), key=lambda k: slots[k][1])
    widest = max((len(row) for run in parameters for row in run), default=0)
    packed = np.zeros((len(parameters), SLOTS, max(widest, REST)))
    for own, run in zip(packed, parameters, strict=True):
        for place, k in zip(own, order, strict=False):
            place[: len(run[k])] = run[k]
    missing = SLOTS - len(slots)
    element = np.array([slots[k][1] for k in order] + [-1] * missing, np.int64)
    jump = np.array([k < len(jumps) and jumps[k] for k in order] + [False] * missing, np.int64)
    laws = *(slots[k][0] for k in order), *[no_law] * missing
    return Laws(tuple(map(compiled_law, laws)), element, packed, jump)
