"""What a recording's residual is compared with in a score test, whitened as its noise asks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.mismatch.parameters import Term, lines_of
from analysis.mismatch.problem import Columns, Rung
from analysis.mismatch.recordings.inputs import at_rest_between_pulses
from analysis.mismatch.recordings.model import DRAWS, made_by_input_noise, residual, slopes, step_of
from analysis.mismatch.recordings.motion import Own
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from analysis.mismatch.recordings.simulation import Simulation
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import ForceLaw, Tones

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings


LITTLE = 0.01  # of a trial, that a mechanism is tried with beside others
SMALLEST, LARGEST = 0.3, 3.0  # what that may make, in deviations of the noise


def columns_of(
    problem: SimulatedRecordings, fitted: SimulatedFit, number: int, terms: Sequence[Term], ringing: Sequence[Term]
) -> Columns:
    """Return what a recording's residual is compared with, whitened as a problem asks; held-out samples take no part.

    What is not whitened only ranks mechanisms: it is of so much of the recording as rough fits look at.
    """
    recorded, plain = fitted.problem.recordings[number], problem.plain
    size = recorded.fitted.stop - recorded.fitted.start
    count = math.ceil(problem.looked_at * size) if plain else size
    # the noise of a force cell is in the residual: in what a mechanism does to it, it would look like the mechanism
    inputs = np.array([at_rest_between_pulses(u) for u in recorded.inputs]).reshape(recorded.inputs.shape)
    simulation = fitted.simulation.with_inputs(number, inputs)
    own = fitted.own[number]

    def off_by(other: Simulation, x: Real, moved: Own) -> Real:
        return residual(other, x, moved, number, samples=count)[0]

    off, at = residual(fitted.simulation, fitted.x, own, number, samples=count)
    shown = off if simulation is fitted.simulation else off_by(simulation, fitted.x, own)
    used = np.isin(recorded.part[at], (FIT, CHOOSE))
    noise = None if plain else fitted.noise(number)

    def white(y: Real) -> Real:
        return (y if noise is None else noise.white(y))[:, used].ravel()

    def changed(x: Real, moved: Own) -> Real:
        return white(off_by(simulation, x, moved) - shown)

    def with_term(term: Term) -> tuple[Simulation, Own]:
        other = simulation.with_terms((*fitted.terms, term), fitted.values)
        return other, replace(other.own(fitted.state(number)), tones=own.tones, impact=own.impact)

    def made(term: Term) -> Real:
        other, state = with_term(term)
        return white(off_by(other, other.begin(), state) - shown)

    def little(term: Term) -> Real:
        """Return what it makes per trial, of so little of it that this is in proportion beside what is at work."""
        weak = weakened(term, LITTLE) if fitted.terms and not plain else None
        if weak is None:
            return made(term)
        column, share = made(weak), LITTLE
        size = float(np.sqrt(np.mean(column**2)))
        if not SMALLEST < size < LARGEST:
            share = min(LITTLE / max(size, 1e-300), 1.0)
            column = made(weakened(term, share) or term)
        return column / share

    def rings(index: int) -> tuple[Real, Real]:
        if not isinstance(ringing[index].mechanism, Tones):
            other, state = with_term(ringing[index])
            begun = off_by(other, other.begin(), state)
            scale = np.diag(other.own_scale(number, state))
            # what nothing drives began somehow; what is driven was at rest, or has forgotten it
            starts = [i + j for i in (0, other.n) for j in range(simulation.n, other.n) if recorded.free]
            moved = [off_by(other, other.begin(), state.moved(scale[i])) for i in starts]
            made_by = white(begun - shown)
            return np.array([white(y - begun) for y in moved]).reshape(len(starts), made_by.size), made_by
        waves = simulation.waves(number, at, lines_of([ringing[index]]))
        rows = [white(np.where(np.arange(len(off))[:, None] == c, w, 0.0)) for c in range(len(off)) for w in waves]
        return np.array(rows), np.zeros(int(used.sum()) * len(off))

    forward = np.ones(fitted.x.size)
    scale = simulation.own_scale(number, own)
    common, own_slopes = slopes(changed, fitted.x, own, step_of(simulation), forward, scale)
    q, _ = np.linalg.qr(own_slopes)
    columns = np.array([little(t) for t in terms]).reshape(len(terms), len(own_slopes)).T

    def rung(against: Real) -> list[Rung]:
        return [Rung.of(i, *rings(i), against) for i in range(len(ringing))]

    counted = problem.draws(fitted) > 0
    drawn = np.array([y[:, used].ravel() for y in noise_drawn(fitted, number)]).T if counted else None
    return Columns(np.arange(fitted.x.size), common, columns, -white(off), q, rung, drawn)


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
