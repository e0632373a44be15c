"""What a recording's residual is compared with in a score test, whitened as its noise asks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.parameters import Term, lines_of
from analysis.mismatch.problem import Columns, Rung
from analysis.mismatch.recordings.inputs import at_rest_between_pulses
from analysis.mismatch.recordings.model import (
    DRAWS,
    made_by_input_noise,
    residual,
    residuals,
    side_by_side,
    slopes,
    steps_of,
    ways,
)
from analysis.mismatch.recordings.motion import SIDE_BY_SIDE, Own, Place
from analysis.mismatch.recordings.nearby import beside_jumps, nearby, roughly
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from analysis.mismatch.recordings.simulation import TOGETHER, Simulation
from sim_backend.acting import laws_in
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import ForceLaw, Tones

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings

LITTLE = 0.01  # of a trial, that a mechanism is tried with beside others
SMALLEST, LARGEST = 0.3, 3.0  # what that may make, in deviations of the noise


class _Compared:
    """A recording's residual, and what other simulations make of it: both whitened, without what is held out.

    What is not whitened only ranks mechanisms: it is of so much of the recording as rough fits look at.
    """

    def __init__(self, problem: SimulatedRecordings, fitted: SimulatedFit, number: int):
        self.fitted, self.number, self.plain = fitted, number, problem.plain
        self.recorded = recorded = fitted.problem.recordings[number]
        size = recorded.fitted.stop - recorded.fitted.start
        self.count = math.ceil(problem.looked_at * size) if self.plain else size
        # the noise of a force cell is in the residual: in what a mechanism does to it, it would look like the mechanism
        inputs = np.array([at_rest_between_pulses(u) for u in recorded.inputs]).reshape(recorded.inputs.shape)
        self.simulation = fitted.simulation.with_inputs(number, inputs)
        self.own = fitted.own[number]
        self.off, self.at = residual(fitted.simulation, fitted.x, self.own, number, samples=self.count)
        same = self.simulation is fitted.simulation
        self.shown = self.off if same else self.off_by(self.simulation, [(fitted.x, self.own)])[0]
        self.tried = roughly(self.simulation)  # and compared with as rough a motion
        bent = bool(laws_in(fitted.terms)) and not fitted.simulation.rough
        self.before = self.off_by(self.tried, [(fitted.x, self.own)])[0] if bent else self.shown
        self.near = nearby(self.simulation, fitted.x, self.own, number, self.count)
        self.beside = beside_jumps(self.near)
        self.used = np.isin(recorded.part[self.at], (FIT, CHOOSE))
        self.size = int(self.used.sum()) * len(self.off)
        self.noise = None if self.plain else fitted.noise(number)

    def off_by(self, other: Simulation, places: Sequence[Place]) -> Real:
        """Return the residuals (places, c, n) that a simulation leaves."""
        return residuals(other, places, self.number, samples=self.count)[0]

    def white(self, y: Real) -> Real:
        """Return all channels' samples (..., n) that count of (..., c, n) as one row, next to jumps nothing."""
        y = np.where(self.beside, 0.0, y) if self.beside.size else y
        white = (y if self.noise is None else self.noise.white(y))[..., self.used]
        return np.asarray(white.reshape(*white.shape[:-2], -1), np.float64)

    def changed(self, places: Sequence[Place]) -> Real:
        """Return (places, n) what other constants and other states make."""
        return self.white(self.off_by(self.near, places) - self.shown)

    def with_each(self, terms: Sequence[Term]) -> Iterator[_Joined]:
        """Return simulations with one mechanism more, of which each is many: what is not too much at once."""
        many = max(TOGETHER // max(self.count * self.simulation.substeps[self.number], 1), 1)
        alike: dict[object, list[int]] = {}
        for i, t in enumerate(terms):
            alike.setdefault((t.mechanism, t.place, t.freed, tuple(sorted(t.fixed.items()))), []).append(i)
        for numbers in alike.values():
            other, state = self._with_term(terms[numbers[0]])
            free = {p.name for p in other.parameters if p.scope == "mechanism" and p.owner == len(self.fitted.terms)}
            if free.issuperset(q.name for q in terms[numbers[0]].mechanism.parameters):
                for some in (numbers[first : first + many] for first in range(0, len(numbers), many)):
                    yield _Joined(np.array(some), other, [(other.begin(terms[i]), state) for i in some])
                continue
            for i in numbers:
                other, state = self._with_term(terms[i])
                yield _Joined(np.array([i]), other, [(other.begin(), state)])

    def _with_term(self, term: Term) -> tuple[Simulation, Own]:
        """Return the simulation with one mechanism more, and the recording's own numbers in it."""
        other = self.tried.with_terms((*self.fitted.terms, term), self.fitted.values)
        state = other.own(self.fitted.state(self.number))
        memory = np.append(self.own.memory, state.memory[self.own.memory.size :])
        return other, replace(state, tones=self.own.tones, impact=self.own.impact, memory=memory)

    def made(self, terms: Sequence[Term]) -> Real:
        """Return (terms, n) what mechanisms make."""
        found = np.zeros((len(terms), self.size))

        def put(one: _Joined) -> None:
            found[one.numbers] = self.white(self.off_by(one.simulation, one.places) - self.before)

        # what is computed together is divided among processors, but most mechanisms have one trial
        if self.count * self.simulation.substeps[self.number] < SIDE_BY_SIDE:
            for one in self.with_each(terms):
                put(one)
        else:
            side_by_side(put, [(one,) for one in self.with_each(terms)])
        return found

    def little(self, terms: Sequence[Term]) -> Real:
        """Return (terms, n) what each makes per trial, of so little of it that this is in proportion beside others."""
        beside, shares = self.fitted.terms and not self.plain, self.fitted.problem.shares
        each = [t.key for t in terms]
        keys = [(key, each[:i].count(key), self.number) for i, key in enumerate(each)]
        begun = [shares.get(key, LITTLE) for key in keys]
        weak = [(weakened(t, b) if beside else None) or t for t, b in zip(terms, begun, strict=True)]
        less = np.array([w is not t for w, t in zip(weak, terms, strict=True)], np.bool_)
        share, columns = np.where(less, begun, 1.0), self.made(weak)
        size = np.sqrt(np.mean(columns**2, axis=1))
        (again,) = np.nonzero(less & ~((size > SMALLEST) & (size < LARGEST)))
        share[again] = np.minimum(share[again] / np.maximum(size[again], 1e-300), 1.0)
        columns[again] = self.made([weakened(terms[i], float(share[i])) or terms[i] for i in again.tolist()])
        shares.update((keys[i], float(share[i])) for i in again.tolist())
        return np.asarray(columns / share[:, None], np.float64)

    def rungs(self, terms: Sequence[Term], against: Real) -> Iterator[Rung]:
        """Return the products of what each start of what rings makes, and of what it makes if nothing set it going."""
        tones = [isinstance(t.mechanism, Tones) for t in terms]
        bodies = np.flatnonzero(~np.array(tones, np.bool_))
        for one in self.with_each([terms[i] for i in bodies.tolist()]):
            yield Rung.of_each(bodies[one.numbers], *self._started(one), against)
        for i in np.flatnonzero(tones).tolist():
            waves = self.simulation.waves(self.number, self.at, lines_of([terms[i]]))
            channel = np.arange(len(self.off))[:, None]
            rows = np.array([np.where(channel == c, w, 0.0) for c in range(len(self.off)) for w in waves])
            yield Rung.of_each(np.array([i]), self.white(rows)[None], np.zeros((1, self.size)), against)

    def _started(self, one: _Joined) -> tuple[Real, Real]:
        """Return (t, k, n) what each start of a body makes, and (t, n) what the body makes if nothing set it going."""
        other, state = one.simulation, one.places[0][1]
        scale = np.diag(other.own_scale(self.number, state))
        # what nothing drives began somehow; what is driven was at rest, or has forgotten it
        added = range(self.simulation.n, other.n) if self.recorded.free else ()
        starts = [i + j for i in (0, other.n) for j in added]
        places = [(x, state.moved(scale[i])) for i in starts for x, _ in one.places]
        begun, *moved = np.split(self.off_by(other, [*one.places, *places]), 1 + len(starts))
        waves = np.array([self.white(y - begun) for y in moved]).reshape(len(starts), len(begun), self.size)
        return waves.swapaxes(0, 1), self.white(begun - self.before)


@dataclass(frozen=True, slots=True)
class _Joined:
    """A simulation with one mechanism more, and a place for each of the trials with these ``numbers``."""

    numbers: NDArray[np.intp]
    simulation: Simulation
    places: list[Place]


def columns_of(
    problem: SimulatedRecordings, fitted: SimulatedFit, number: int, terms: Sequence[Term], ringing: Sequence[Term]
) -> Columns:
    """Return what a recording's residual is compared with, whitened as a problem asks, without what is held out."""
    compared = _Compared(problem, fitted, number)
    scale = compared.simulation.own_scale(number, compared.own)
    steps = steps_of(compared.simulation, fitted.x, compared.own, number, compared.count)
    forward = ways(compared.simulation)
    common, own_slopes = slopes(compared.changed, fitted.x, compared.own, steps, forward, scale)
    q, _ = np.linalg.qr(own_slopes)
    columns = compared.little(terms).T
    rung = partial(compared.rungs, ringing)
    counted = problem.draws(fitted) > 0
    drawn = np.array([y[:, compared.used].ravel() for y in noise_drawn(fitted, number)]).T if counted else None
    return Columns(np.arange(fitted.x.size), common, columns, -compared.white(compared.off), q, rung, drawn)


def noise_drawn(fitted: SimulatedFit, number: int, samples: int | None = None) -> Real:
    """Return (draws, c, n) draws of a recording's noise, whitened: its channels' own and what its inputs' makes.

    Of what is fitted, or of so many samples from its beginning.
    """
    recorded, noise, own = fitted.problem.recordings[number], fitted.noise(number), fitted.own[number]
    count = recorded.fitted.stop - recorded.fitted.start if samples is None else samples
    random = np.random.default_rng(number).standard_normal((DRAWS, len(recorded.outputs), count))
    if noise.driven is None:
        return random
    made = made_by_input_noise(fitted.simulation, fitted.x, own, number, samples)
    drawn = random * np.sqrt(noise.driven.white)[:, None]
    drawn += 0.0 if made is None else made * noise.driven.share[:, None]
    return np.array([noise.white(rows) for rows in drawn])


def weakened(term: Term, share: float) -> Term | None:
    """Return a force law with a share of its strength; None of what has no strength in proportion to its force.

    Beside a spring that bends, a trial's force moves the phase of a long recording so far that what it makes is no
    longer what a little of it would make.
    """
    law = term.mechanism
    if not isinstance(law, ForceLaw):
        return None
    # its strength, and all else that a force is in proportion to: creep changes a stiffness and a damping
    sizes = [q for q in law.parameters if q.name == law.strength or q.unit.startswith("N")]
    if not sizes or any(q.log for q in sizes):
        return None
    return term.within({q.name: share * term.values[q.name] for q in sizes})
