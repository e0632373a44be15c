"""What a recording's residual is compared with in a score test, whitened as its noise asks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

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
from analysis.mismatch.recordings.nearby import beside_jumps, nearby
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from analysis.mismatch.recordings.simulation import Simulation
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import ForceLaw, Tones

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings


Made = TypeVar("Made")

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
        self.shown = self.off if same else self.off_by(self.simulation, fitted.x, self.own)
        self.near = nearby(self.simulation, fitted.x, self.own, number, self.count)
        self.beside = beside_jumps(self.near)
        self.used = np.isin(recorded.part[self.at], (FIT, CHOOSE))
        self.noise = None if self.plain else fitted.noise(number)

    def off_by(self, other: Simulation, x: Real, moved: Own) -> Real:
        """Return the residual (c, n) that a simulation leaves."""
        return residual(other, x, moved, self.number, samples=self.count)[0]

    def white(self, y: Real) -> Real:
        """Return one row of all channels' samples that count, next to jumps nothing."""
        y = np.where(self.beside, 0.0, y) if self.beside.size else y
        return (y if self.noise is None else self.noise.white(y))[:, self.used].ravel()

    def changed(self, places: Sequence[Place]) -> Real:
        """Return (places, n) what other constants and other states make."""
        made, _ = residuals(self.near, places, self.number, samples=self.count)
        return np.array([self.white(y - self.shown) for y in made])

    def with_term(self, term: Term) -> tuple[Simulation, Own]:
        """Return the simulation with one mechanism more, and the recording's own numbers in it."""
        other = self.simulation.with_terms((*self.fitted.terms, term), self.fitted.values)
        state = other.own(self.fitted.state(self.number))
        memory = np.append(self.own.memory, state.memory[self.own.memory.size :])
        return other, replace(state, tones=self.own.tones, impact=self.own.impact, memory=memory)

    def made(self, term: Term) -> Real:
        """Return what a mechanism makes."""
        other, state = self.with_term(term)
        return self.white(self.off_by(other, other.begin(), state) - self.shown)

    def little(self, term: Term) -> Real:
        """Return what it makes per trial, of so little of it that this is in proportion beside what is at work."""
        weak = weakened(term, LITTLE) if self.fitted.terms and not self.plain else None
        if weak is None:
            return self.made(term)
        column, share = self.made(weak), LITTLE
        size = float(np.sqrt(np.mean(column**2)))
        if not SMALLEST < size < LARGEST:
            share = min(LITTLE / max(size, 1e-300), 1.0)
            column = self.made(weakened(term, share) or term)
        return column / share

    def of_each(self, made: Callable[[Term], Made], terms: Sequence[Term]) -> list[Made]:
        """Return what each mechanism makes, side by side where the simulation is most of the work."""
        if self.count * self.simulation.substeps[self.number] < SIDE_BY_SIDE:
            return [made(term) for term in terms]
        return side_by_side(made, [(term,) for term in terms])

    def rings(self, term: Term) -> tuple[Real, Real]:
        """Return (k, n) what each start of what rings makes, and what it makes if nothing set it going."""
        if not isinstance(term.mechanism, Tones):
            other, state = self.with_term(term)
            begun = self.off_by(other, other.begin(), state)
            scale = np.diag(other.own_scale(self.number, state))
            # what nothing drives began somehow; what is driven was at rest, or has forgotten it
            added = range(self.simulation.n, other.n) if self.recorded.free else ()
            starts = [i + j for i in (0, other.n) for j in added]
            places = [(other.begin(), state.moved(scale[i])) for i in starts]
            moved = residuals(other, places, self.number, samples=self.count)[0] if places else ()
            made_by = self.white(begun - self.shown)
            return np.array([self.white(y - begun) for y in moved]).reshape(len(starts), made_by.size), made_by
        waves = self.simulation.waves(self.number, self.at, lines_of([term]))
        channel = np.arange(len(self.off))[:, None]
        rows = [self.white(np.where(channel == c, w, 0.0)) for c in range(len(self.off)) for w in waves]
        return np.array(rows), np.zeros(int(self.used.sum()) * len(self.off))


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
    columns = np.array(compared.of_each(compared.little, terms)).reshape(len(terms), len(own_slopes)).T

    def rung(against: Real) -> list[Rung]:
        return [Rung.of(i, *made, against) for i, made in enumerate(compared.of_each(compared.rings, ringing))]

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
