"""Damped Gauss-Newton with variable projection: what belongs to one segment alone is eliminated in every step.

The solver knows nothing of physics; `linearised` says what a model tells it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np

from analysis.mismatch.linearised import (
    Evaluation,
    Fitted,
    Linearisation,
    Point,
    Tangent,
    bounded_step,
    gradient_of,
    own_steps,
)
from sim_backend.arrays import Real

TIES = 1e-6  # rise of the objective that still counts as none
LEAST_DAMPING, MOST_DAMPING = 1e-6, 1e5
DAMPED_MORE, DAMPED_LESS = 5.0, 10.0  # factors from a step that failed to the next, doubled each time; and back
PROBED = 0.1  # of a step, at which its second derivative is looked up
MOST_BENT = 0.75  # second over first derivative along a step, beyond which it is straight
SLOW_START = 4  # linearisations after which slopes are computed in full
QUICK = 0.3  # of what the step before gained, below which a step with slopes used again comes near the minimum
UNSURE = 1.0  # fall of chi-squared, over the reduced one, below which what costly slopes promise may be their error
CORRECTIONS = 6  # steps with the same slopes that follow a damped one at most: a linearisation costs ten or more
LITTLE_MORE = 0.1  # of what all of them gained, below which no further one is made
MOST_REUSED = 6  # steps with slopes used again: as many cost about as much as new slopes


@dataclass(frozen=True, slots=True)
class Stopping:
    """When to end.

    Attributes
    ----------
    most
        Linearisations.
    gain
        Fall of the objective below which a fit has converged; ``share`` likewise, of the objective.
    damping
        Of the first step.
    tries
        Of one step, each damped more.
    reference
        Objective of the fit that this one competes with: it ends where steps gain little beside their difference.
    to_beat
        Objective that a competing fit has to reach to matter.
    """

    most: int
    gain: float
    share: float = 0.0
    damping: float = 0.0
    tries: int = 8
    reference: float | None = None
    to_beat: float = math.inf


@dataclass(frozen=True, slots=True)
class Race:
    """When a competing fit is given up or counts as done; see `SelectionPolicy`."""

    little: float
    little_share: float
    beaten: float
    beaten_after: int
    as_expected: float


def minimise(
    model: Fitted[Point], start: Evaluation[Point], stopping: Stopping, race: Race, exact: bool = False
) -> tuple[Evaluation[Point], bool]:
    """Step until nothing is gained.

    Parameters
    ----------
    exact
        Whether full derivatives are used from the start.

    Returns
    -------
    tuple
        The evaluation at the minimum, and whether full derivatives were used in the end.
    """
    at, damping, stalled, iteration, reused, gain = start, stopping.damping, 0, 0, 0, math.inf
    exact = exact or not model.approximates
    slopes: Linearisation | None = None
    while iteration < stopping.most and not _given_up(at.objective, gain, iteration, stopping, race):
        fresh, slopes = slopes is None, slopes or model.linearise(at, exact)
        iteration, reused = iteration + fresh, 0 if fresh else reused + 1
        begun = damping
        tries, scale = stopping.tries if fresh else 1, _scale(at.objective, stopping) if exact else 0.0
        limits = tries, stopping.gain * scale, UNSURE * scale
        trial, damping = _tried(model, at, slopes, damping, iteration, limits)
        if trial is None:
            if exact and (fresh or damping == 0):
                break
            exact, damping, slopes = exact or fresh, 0.0, None
            continue
        before, gain = gain, at.objective - trial.found.objective
        quick = fresh or (gain < QUICK * before and reused < MOST_REUSED)
        as_expected = model.reuses and exact and damping == 0 and gain > race.as_expected * trial.expected
        if damping == begun:
            damping = damping / DAMPED_LESS if damping > LEAST_DAMPING else 0.0
        if gain >= _enough(trial.found.objective, stopping, race):
            exact = exact or iteration > SLOW_START
        else:
            stalled += fresh or as_expected
        slopes, at = _corrected(slopes, at, trial) if as_expected and quick else None, trial.found
        if stalled >= 2 - exact:
            break
    return at, exact


@dataclass(frozen=True, slots=True)
class _Trial(Generic[Point]):
    """A step of the common parameters (k,) and of each segment's own, what it promised and what it ``found``."""

    found: Evaluation[Point]
    expected: float
    step: Real
    own: Sequence[Real]


def _tried(
    model: Fitted[Point],
    at: Evaluation[Point],
    slopes: Linearisation,
    damping: float,
    iteration: int,
    limits: tuple[int, float, float],
) -> tuple[_Trial[Point] | None, float]:
    """Step with more and more damping; return the first that does not rise, and its damping.

    ``limits`` are how often it tries, the fall that is not worth a step, and one that may be an error of the slopes.
    With costly slopes that promise no more than the first no step is made; where they promise less than the other and
    the first step rises, it is they that are not good enough.
    Damping does nothing to a segment's own coefficients: where these are all that moves, one step tells.
    """
    gradient, targets = gradient_of(model, slopes, at)
    tries, enough, unsure = limits
    tries = min(tries, 1) if model.fixed.all() else tries
    for i in range(tries):
        step = bounded_step(slopes.normal, gradient, damping, model.fixed, model.bounds(at))
        own = own_steps(slopes, targets, step)
        expected = float(gradient @ step) + sum(float(t @ t) for t in targets)
        if model.reuses and damping == 0 and expected < enough:
            break
        path = _bent(model, at, slopes, damping, step, own, iteration) if model.bends and damping else (step, own)
        found = model.moved(at, *path, iteration)
        if model.settles and damping and found is not None:
            found = _brought_down(model, at, slopes, damping, found, iteration)
        if found is not None and found.objective <= at.objective + TIES:
            return _Trial(found, expected, *path), damping
        if model.reuses and tries > 1 and damping == 0 and expected < unsure:
            break
        damping = max(2**i * DAMPED_MORE * damping, LEAST_DAMPING)
        if damping > MOST_DAMPING:
            break
    return None, damping


def _brought_down(
    model: Fitted[Point],
    at: Evaluation[Point],
    slopes: Linearisation,
    damping: float,
    found: Evaluation[Point],
    iteration: int,
) -> Evaluation[Point]:
    """Return what further steps with the same slopes and damping make of a step, as long as each falls enough.

    Along a bent valley whose walls are steep a straight step rises; what it lacks is told by the same slopes.
    """
    gain = math.inf
    for _ in range(CORRECTIONS):
        gradient, targets = gradient_of(model, slopes, found)
        step = bounded_step(slopes.normal, gradient, damping, model.fixed, model.bounds(found))
        further = model.moved(found, step, own_steps(slopes, targets, step), iteration)
        if further is None or further.objective >= found.objective:
            break
        before, gain = gain, found.objective - further.objective
        found = further
        if gain < LITTLE_MORE * (at.objective - found.objective) or gain > before:
            break
    return found


def _corrected(slopes: Linearisation, at: Evaluation[Point], trial: _Trial[Point]) -> Linearisation:
    """Return slopes that tell of the last step what it did: of all that do, those that differ least (Broyden, 1965).

    What the step did beyond what they told is counted as an effect of the common parameters, each measured by what it
    does. Slopes that are a little off, in a direction along which all else can make up for most of a step, would
    otherwise creep towards the minimum.
    """
    size = np.maximum(np.diag(slopes.normal), 0.0)
    normal, tangents = slopes.normal.copy(), []
    for t, before, after, own in zip(slopes.tangents, at.residuals, trial.found.residuals, trial.own, strict=True):
        step = trial.step[t.where]
        weight = size[t.where] * step
        length = float(weight @ step)
        if length > 0:
            told = t.q @ (t.r @ own + t.cross @ step) + t.common @ step
            missed = (before - after).ravel() - told
            mimicked = t.q.T @ missed
            cross = t.cross + np.outer(mimicked, weight / length)
            common = t.common + np.outer(missed - t.q @ mimicked, weight / length)
            normal[np.ix_(t.where, t.where)] += common.T @ common - t.common.T @ t.common
            t = Tangent(t.where, t.q, t.r, cross, common)
        tangents.append(t)
    return Linearisation(slopes.basis, normal, tuple(tangents))


def _bent(
    model: Fitted[Point],
    at: Evaluation[Point],
    slopes: Linearisation,
    damping: float,
    step: Real,
    own: Sequence[Real],
    iteration: int,
) -> tuple[Real, Sequence[Real]]:
    """Return a step that follows a bent valley: with half its geodesic acceleration (Transtrum and Sethna, 2012).

    It is straight where the model has no second derivative along it that is small beside the first.
    """
    near = model.moved(at, PROBED * step, [PROBED * o for o in own], iteration)
    if near is None:
        return step, own
    bends = []
    for t, before, after, mine in zip(slopes.tangents, at.residuals, near.residuals, own, strict=True):
        straight = t.q @ (t.r @ mine + t.cross @ step[t.where]) + t.common @ step[t.where]
        bends.append(2 / PROBED * (straight - (before - after).ravel() / PROBED))
    gradient = np.zeros(step.size)
    for t, bend in zip(slopes.tangents, bends, strict=True):
        gradient[t.where] += t.common.T @ bend
    low, high = model.bounds(at)
    turn = bounded_step(slopes.normal, gradient, damping, model.fixed, (2 * (low - step), 2 * (high - step)))
    size = np.sqrt(np.maximum(np.diag(slopes.normal), 1e-300))
    if np.linalg.norm(size * turn) * 2 > MOST_BENT * np.linalg.norm(size * step):
        return step, own
    turns = own_steps(slopes, [t.q.T @ bend for t, bend in zip(slopes.tangents, bends, strict=True)], turn)
    return step + turn / 2, [o + b / 2 for o, b in zip(own, turns, strict=True)]


def _given_up(objective: float, gain: float, iteration: int, stopping: Stopping, race: Race) -> bool:
    """Whether a competing fit has no prospect."""
    return (
        math.isfinite(stopping.to_beat)
        and iteration >= race.beaten_after
        and objective - race.beaten * gain > stopping.to_beat
    )


def _enough(objective: float, stopping: Stopping, race: Race) -> float:
    """Fall of the objective below which nothing much is gained."""
    least = max(stopping.gain, stopping.share * objective)
    if stopping.reference is None:
        return least
    little = max(race.little * _scale(objective, stopping), race.little)
    return max(least, min(race.little_share * abs(stopping.reference - objective), little))


def _scale(objective: float, stopping: Stopping) -> float:
    """Return what chi-squared is measured by: the reduced one where that is above 1; 0 where the noise is not known."""
    return max(1.0, stopping.share * objective / stopping.gain) if stopping.gain > 0 else 0.0
