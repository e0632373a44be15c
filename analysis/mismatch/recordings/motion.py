"""How a described rig moves at the samples of a recording and before the first of them, and what sets it going."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from analysis.mismatch.recordings.recorded import Recorded, level
from sim_backend.arrays import Real
from sim_backend.propagate import Clock, Division, Given, Rigs, laws_of, propagate
from sim_backend.propagate import Motion as Propagated

if TYPE_CHECKING:
    from analysis.mismatch.parameters import Term
    from analysis.mismatch.recordings.simulation import Simulation

BEFORE = 32  # samples before the first that what remembers is shown
GROWTH = 10.0  # of a motion followed backwards, up to which it is: what has died out cannot be told
TOLERANCE: Final = 1e-5  # see `propagate`: along a decay of 60 periods errors of 3e-4 add up to a quarter of the noise
ROUGHLY: Final = 0.01  # of the noise over what is shown, likewise for what a score test tries
ROUGHEST: Final = 3e-4  # likewise, of decays of 27 periods: errors are up to 0.013 of the noise
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
        (any,) what is remembered at the first sample of what was before; see `memories`.
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


Place = tuple[Real, Own]
"""Parameters as they are fitted, and what is a recording's own."""


@dataclass(frozen=True, slots=True)
class Motion:
    """At the samples: states (n, 2 bodies), extra forces (n, elements), inputs' forces on the bodies (n, bodies).

    Of several runs, these come first. ``division`` (runs, any) is that of their steps, where it was asked for; see
    `sim_backend.propagate.Motion`.
    """

    states: Real
    extra: Real
    force: Real
    division: Division = field(default_factory=lambda: np.zeros((1, 0), np.int8))

    def __getitem__(self, run: int) -> Motion:
        """Return one of several."""
        return Motion(self.states[run], self.extra[run], self.force[run], self.division[run : run + 1])

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


def sensible(mass: Real, damping: Real, stiffness: Real, rate: float) -> NDArray[np.bool_]:
    """Return (...,) which rigs can be stepped at all: extra forces aside, no mode faster than the sampling allows."""
    told = np.all(np.isfinite(mass) & (mass > 0), axis=-1) & np.all(np.isfinite(stiffness), axis=(-1, -2))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        squared, decay = (np.abs(k / mass[..., None]).sum(axis=-1).max(axis=-1) for k in (stiffness, damping))
    return np.asarray(told & (np.sqrt(squared) < 40 * rate) & (decay < 100 * rate), np.bool_)


@dataclass(frozen=True, slots=True)
class Read:
    """What several places mean, of those whose rig can be stepped: these ``runs`` of them, m in all.

    ``constants`` are (m,) each, ``one_by_one`` those of each run; ``matrices`` are masses (m, n), damping and stiffness
    (m, n, n).
    """

    runs: NDArray[np.intp]
    own: list[Own]
    one_by_one: list[dict[str, float]]
    terms: list[tuple[Term, ...]]
    constants: dict[str, Real]
    matrices: tuple[Real, Real, Real]

    @classmethod
    def of(cls, simulation: Simulation, places: Sequence[Place], rate_hz: float) -> Read:
        """Return what parameters and own numbers mean for a recording of this sampling rate."""
        read = [simulation.read(x) for x, _ in places]
        constants = {name: np.array([one[name] for one, _ in read]) for name in simulation.constants}
        matrices = simulation.arrangement.matrices(constants)
        runs = np.flatnonzero(sensible(*matrices, rate_hz))
        if runs.size < len(places):
            constants = {name: values[runs] for name, values in constants.items()}
            mass, damping, stiffness = matrices
            matrices = mass[runs], damping[runs], stiffness[runs]
        own, kept = [places[i][1] for i in runs.tolist()], [read[i] for i in runs.tolist()]
        return cls(runs, own, [one for one, _ in kept], [terms for _, terms in kept], constants, matrices)


def continued(simulation: Simulation, states: Sequence[Real], begun: Simulation, own: Sequence[Own]) -> list[Own]:
    """Return what is each recording's own, for states (2n,) of the rig, from where another simulation was.

    Tones where there are as many, an impact where one is looked for, and what is remembered by the same mechanisms.
    """
    before = {(begun.terms[i].key, where): k for k, (i, where) in enumerate(begun.memories)}
    kept = [before.get((simulation.terms[i].key, where)) for i, where in simulation.memories]
    found = []
    for state, other in zip(states, own, strict=True):
        one = simulation.own(state)
        tones = other.tones if other.tones.shape == one.tones.shape else one.tones
        memory = np.array([0.0 if k is None else other.memory[k] for k in kept])
        found.append(Own(one.state, tones, other.impact if simulation.struck is not None else one.impact, memory))
    return found


def rough_tolerance(recorded: Recorded) -> float:
    """Return how roughly what a score test tries is simulated, by the noise that a recording is taken to have."""
    return float(np.clip(ROUGHLY * np.min(recorded.unit / level(recorded)), TOLERANCE, ROUGHEST))


@dataclass(frozen=True, slots=True)
class Begun:
    """What motions are computed from: rigs, parameters of each one's laws (each any), inputs, first states (runs, 2n).

    Inputs may be the same for all.
    """

    rigs: Rigs
    laws: Sequence[Sequence[Real]]
    given: Sequence[Given]
    start: Real


def computed(
    begun: Begun,
    slots: Sequence[tuple[Any, int]],
    jumps: Sequence[bool],
    clock: Clock,
    division: Division | None = None,
    keeps_division: bool = False,
    rough: Recorded | None = None,
) -> Propagated:
    """Return the motions of rigs whose force laws and time axis are the same; see `laws_of` and `propagate`.

    As roughly as a recording's noise allows, if one is given.
    """
    tolerance = TOLERANCE if rough is None else rough_tolerance(rough)
    runs = len(begun.start)
    workers = min(len(os.sched_getaffinity(0)), runs) if runs * clock.steps > SIDE_BY_SIDE else 1
    edges = np.linspace(0, runs, workers + 1).astype(int).tolist()

    def of_share(share: slice) -> Propagated:
        rigs, start, givens = Rigs(*(a[share] for a in begun.rigs)), begun.start[share], begun.given[share]
        laws, given = laws_of(slots, begun.laws[share], jumps), givens[0]
        if any(one is not given for one in givens):
            begin, end, bend = (np.concatenate([one[i] for one in givens]) for i in range(3))
            given = Given(begin, end, bend, given.held)
        every = clock._replace(start=np.repeat(clock.start, len(start)))
        return propagate(rigs, laws, start, every, given, None, tolerance, division, keeps_division)

    shares = [slice(first, last) for first, last in pairwise(edges)]
    if workers < 2:
        return of_share(shares[0])
    with ThreadPoolExecutor(workers) as pool:  # compiled code lets go of the interpreter
        found = list(pool.map(of_share, shares))
    forces, bends, states, divided = (
        np.concatenate([getattr(one, name) for one in found]) for name in ("forces", "bends", "states", "division")
    )
    return Propagated(forces, bends, states, divided)
