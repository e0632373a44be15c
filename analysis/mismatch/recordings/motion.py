"""How a described rig moves at the samples of a recording and before the first of them, and what sets it going."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
from scipy.linalg import expm

from sim_backend.arrays import Real
from sim_backend.propagate import Clock, Division, Given, Rigs, laws_of, propagate
from sim_backend.propagate import Motion as Propagated

BEFORE = 32  # samples before the first that what remembers is shown
GROWTH = 10.0  # of a motion followed backwards, up to which it is: what has died out cannot be told
TOLERANCE: Final = 1e-5  # see `propagate`: along a decay of 60 periods errors of 3e-4 add up to a quarter of the noise
SIDE_BY_SIDE: Final = 20_000  # steps, from which on each processor takes its share of the motions


def _none() -> Real:
    return np.zeros(0)


@dataclass(frozen=True, slots=True)
class Own:
    """What is each recording's own.

    Attributes
    ----------
    state, tones
        The state (2n,) where fitting begins, and (channels, 2 lines) of tones.
    impact
        Time (s, from the first sample) of a second impact and how much faster (m/s) the body is that it strikes; empty
        without one.
    memory
        (channels,) what each channel remembers at the first sample of what was before, where something makes it.
    """

    state: Real
    tones: Real
    impact: Real = field(default_factory=_none)
    memory: Real = field(default_factory=_none)

    @property
    def size(self) -> int:
        """Numbers in it."""
        return self.state.size + self.tones.size + self.impact.size + self.memory.size

    def moved(self, step: Real) -> Own:
        """Return it after a step (size,)."""
        n, m = self.state.size, self.state.size + self.tones.size
        k = m + self.impact.size
        tones = self.tones + step[n:m].reshape(self.tones.shape)
        return Own(self.state + step[:n], tones, self.impact + step[m:k], self.memory + step[k:])

    def beginning(self, other: Own, struck: bool) -> Own:
        """Return it with another one's tones and memory where it has as many, and its impact where ``struck``."""
        return Own(
            self.state,
            other.tones if other.tones.shape == self.tones.shape else self.tones,
            other.impact if struck else self.impact,
            other.memory if other.memory.size == self.memory.size else self.memory,
        )


Place = tuple[Real, Own]
"""Parameters as they are fitted, and what is a recording's own."""


@dataclass(frozen=True, slots=True)
class Motion:
    """At the samples: states (n, 2 bodies), extra forces (n, elements), inputs' forces on the bodies (n, bodies).

    ``division`` is that of its steps, where it was asked for; see `sim_backend.propagate.Motion`.
    """

    states: Real
    extra: Real
    force: Real
    division: Division = field(default_factory=lambda: np.zeros((1, 0), np.int8))

    def begun_earlier(self, mass: Real, damping: Real, stiffness: Real, rate_hz: float) -> Motion:
        """Return a free decay with samples before its first, as the linear rig (n,), (n, n), (n, n) came there."""
        back = backwards(mass, damping, stiffness) / rate_hz
        growth = float(np.linalg.eigvals(back).real.max())
        count = BEFORE if growth * BEFORE <= math.log(GROWTH) else int(math.log(GROWTH) / growth)
        step, states = expm(back), [self.states[0]]
        for _ in range(count):
            states.append(step @ states[-1])
        still = [np.zeros((count, rows.shape[1])) for rows in (self.extra, self.force)]
        return Motion(
            np.concatenate([states[:0:-1], self.states]) if count else self.states,
            np.concatenate([still[0], self.extra]),
            np.concatenate([still[1], self.force]),
        )


def backwards(mass: Real, damping: Real, stiffness: Real) -> Real:
    """Return (2n, 2n) the slope of a free linear rig's state when time runs backwards, 1/s."""
    n = mass.size
    out = np.zeros((2 * n, 2 * n))
    out[:n, n:], out[n:, :n], out[n:, n:] = -np.eye(n), stiffness / mass[:, None], damping / mass[:, None]
    return out


def impulse(substeps: int, substep: float, size: float) -> Real:
    """Return (2, substeps) a force that is an impulse, where each substep begins and ends.

    It acts in one substep only, in which its moments of order zero and one are those of the impulse.

    Parameters
    ----------
    substep
        When, in substeps from the first; one beyond either end adds nothing.
    size
        The impulse over the length of a substep, N.

    Examples
    --------
    >>> impulse(4, 1.25, 2.0).tolist()
    [[0.0, 5.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0]]
    """
    first, out = math.floor(substep), np.zeros((2, substeps))
    if 0 <= first < substeps:
        passed = substep - first
        out[:, first] = size * (4 - 6 * passed), size * (6 * passed - 2)
    return out


def with_impulse(given: Given, substep: float, size: float) -> Given:
    """Return inputs of one run with an impulse as one more, every substep by itself; see `impulse`."""
    rows = [np.repeat(u[0], given.held, axis=1) for u in (given.start, given.end, given.bend)]
    begin, end = impulse(rows[0].shape[1], substep, size)
    start, stop, bend = (np.vstack([u, s])[None] for u, s in zip(rows, (begin, end, 0 * begin), strict=True))
    return Given(start, stop, bend, 1)


def sensible(mass: Real, damping: Real, stiffness: Real, rate: float) -> bool:
    """Whether the rig can be stepped at all: the extra forces aside, no mode faster than the sampling allows."""
    if not (np.all(np.isfinite(mass)) and np.all(mass > 0) and np.all(np.isfinite(stiffness))):
        return False
    fastest = math.sqrt(float(np.abs(stiffness / mass[:, None]).sum(axis=1).max()))
    return fastest < 40 * rate and float(np.abs(damping / mass[:, None]).sum(axis=1).max()) < 100 * rate


@dataclass(frozen=True, slots=True)
class Begun:
    """What one motion is computed from: a rig, parameters of its laws (each any), inputs, the first state (2n,).

    ``force`` (n, bodies) is that of the inputs at the samples.
    """

    rig: Rigs
    laws: Sequence[Real]
    given: Given
    start: Real
    force: Real


def computed(
    begun: Sequence[Begun],
    slots: Sequence[tuple[Any, int]],
    jumps: Sequence[bool],
    clock: Clock,
    division: Division | None = None,
    keeps_division: bool = False,
) -> list[Propagated]:
    """Return the motions of rigs whose force laws and time axis are the same; see `laws_of` and `propagate`."""
    workers = min(len(os.sched_getaffinity(0)), len(begun)) if len(begun) * clock.steps > SIDE_BY_SIDE else 1
    edges = np.linspace(0, len(begun), workers + 1).astype(int).tolist()
    shares = [begun[first:last] for first, last in pairwise(edges)]

    def of_share(share: Sequence[Begun]) -> Propagated:
        rigs = Rigs(*(np.concatenate(arrays) for arrays in zip(*(one.rig for one in share), strict=True)))
        laws, given = laws_of(slots, [one.laws for one in share], jumps), share[0].given
        if any(one.given is not given for one in share):
            begin, end, bend = (np.concatenate([one.given[i] for one in share]) for i in range(3))
            given = Given(begin, end, bend, given.held)
        start = np.array([one.start for one in share])
        every = clock._replace(start=np.repeat(clock.start, len(share)))
        return propagate(rigs, laws, start, every, given, None, TOLERANCE, division, keeps_division)

    if workers < 2:
        found = [of_share(share) for share in shares if share]
    else:  # compiled code lets go of the interpreter
        with ThreadPoolExecutor(workers) as pool:
            found = list(pool.map(of_share, shares))
    at = [(motion, slice(i, i + 1)) for motion in found for i in range(len(motion.states))]
    return [Propagated(m.forces[i], m.bends[i], m.states[i], m.division[i]) for m, i in at]
