"""Other linear rigs than the one that was fitted, from which mechanisms are fitted.

Three stiffnesses of which two frequencies tell can change together while no channel shows it. A force that is not
linear does show it, as the body that a sensor does not see moves more or less beside the one it sees: a fit of such a
law that begins from one of these rigs may have to pass a ridge to get to where it belongs. And where a law changes
much, a linear rig may have put its modes where they are not: two at one that shifts with amplitude, none at another.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.recordings.determined import DRAWS, SEED, flat_directions, shown_by, unknown
from analysis.mismatch.recordings.fit import NEAR_LINEAR, SimulatedFit, SimulatedRecordings, fit
from analysis.mismatch.recordings.joining import joined_to
from analysis.mismatch.recordings.other_constants import WIDE, same_shown
from analysis.mismatch.recordings.ranking import with_time
from analysis.mismatch.recordings.spectral_model import SpectralModel, Unknowns
from analysis.mismatch.recordings.start_values import with_first_states
from analysis.mismatch.rig_description import DescribedRig
from analysis.mismatch.score_test import Score, Screening, screen
from analysis.session import AnalysisError
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AddedBody, ForceLaw, Mechanism

STRIDE: Final = 0.1  # in the logarithm of stiffnesses and masses
STRIDES: Final = 12  # each way
APART: Final = 0.3  # of some stiffness or mass from one rig to the next that is tried, in the logarithm
LEAST_DAMPING: Final = 0.3  # of the mean, of any element: one without could not change by a factor
OWN: Final = 0.05  # share of a direction that is no common factor of all forces, from which on motions change in it
EQUAL: Final = 1e-16  # of the sum of squares of all that is shown, that is rounding
CORRECTIONS: Final = 20
LAWS, PLACES = 2, 3  # best laws that are fitted from each rig, in so many of the places where they promise most
HOPELESS: Final = 4.0  # times what is left from the rig that was fitted, beyond which another one is no other start
LIKELIER: Final = 0.5  # of what is left from the rig that was fitted, below which another one takes its place

Fits = list[tuple[Score, SimulatedFit]]


def likelier_rig(
    problem: SimulatedRecordings,
    linear: SimulatedFit,
    screened: Callable[[SimulatedFit], Screening],
    joined: Callable[[SimulatedFit, Score], SimulatedFit],
) -> tuple[SimulatedFit, SimulatedFit]:
    """Return the linear rig beside which the best mechanism leaves least, of those that spectra hardly tell apart.

    Others than the one that was fitted are tried where this one misses much, with its best mechanism, too. The
    fit with the best mechanism is returned as well; the linear one where that was not looked at.

    Parameters
    ----------
    screened, joined
        Scores of the mechanisms beside a fit, and a fit with one of them.
    """
    if linear.terms or linear.missed < NEAR_LINEAR or not problem.rivals:
        return linear, linear

    def with_best(beside: SimulatedFit) -> SimulatedFit:
        promising = [s for s in _places(screened(beside).scores) if isinstance(s.term.mechanism, ForceLaw | AddedBody)]
        return min((joined(beside, s) for s in promising[:PLACES]), key=lambda f: f.scatter, default=beside)

    best, nearest = linear, with_best(linear)
    for constants, states in problem.rivals:
        if nearest.as_noise:
            break
        other = fit(replace(problem, constants=constants, states=states), fine=True)
        if other.scatter > HOPELESS * linear.scatter:  # or it does not move at all
            continue
        near = with_best(other)
        if near.scatter < LIKELIER * nearest.scatter:
            best, nearest = other, near
    return best, nearest


def begun_from_equal_rigs(
    problem: SimulatedRecordings, linear: SimulatedFit, fits: Fits, screened: Callable[[SimulatedFit], Screening]
) -> Fits:
    """Fit the best laws from linear rigs that show the same as the one fitted, too; keep the best fit in each place.

    Where the linear rig misses much, the best law is fitted again from those that show the same as the rig beside it.
    Not where the linear rig leaves more than noise and the best law nothing: it has told which rig it is.
    """
    laws: dict[str, tuple[Score, SimulatedFit]] = {}
    for score, fitted in sorted(fits, key=lambda pair: pair[1].scatter):
        if isinstance(score.term.mechanism, ForceLaw) and not with_time(score.term.mechanism):
            laws.setdefault(score.term.mechanism.id, (score, fitted))
    if not laws:
        return fits
    (best, begun), near = next(iter(laws.values())), linear.missed < NEAR_LINEAR
    starts = _equal_starts(problem, (linear if near else begun).values)
    if not starts or (not linear.as_noise and screened(begun).p_value >= problem.policy.level):
        return fits
    found = {score.term.key: (score, fitted) for score, fitted in fits}
    for there in starts:
        if near:
            again = _from_there(there, [s.term.mechanism for s, _ in laws.values()][:LAWS])
        else:
            again = [(best, fit(there, begun.terms, staged=True))]
        for score, fitted in again:
            if score.term.key not in found or fitted.scatter < found[score.term.key][1].scatter:
                found[score.term.key] = score, fitted
    return list(found.values())


def _equal_starts(problem: SimulatedRecordings, values: Mapping[str, float]) -> list[SimulatedRecordings]:
    """Return the problem from each of the rigs that show the same, none where they cannot be computed."""
    try:
        equal = equal_constants(problem.rig, values)
        states = with_first_states(problem.rig, problem.recordings, equal, problem.highest_hz) if equal else []
    except (AnalysisError, ArithmeticError, np.linalg.LinAlgError):
        return []
    return [replace(problem, constants=c, states=s) for c, s in states]


def _from_there(problem: SimulatedRecordings, laws: Sequence[Mechanism]) -> Fits:
    """Fit laws beside the linear rig that a problem begins with, in the places where they promise most there."""
    linear = fit(problem, fine=True)
    scores = _places(screen(problem, linear, laws).scores)[: LAWS * PLACES]
    promising = [s for s in scores if s.gain >= problem.policy.close * scores[0].gain]
    return [(score, joined_to(problem, linear, score)) for score in promising]


def _places(scores: Sequence[Score]) -> list[Score]:
    """Return the best score of each mechanism in each place, the best first."""
    best: dict[tuple[str, tuple[int, ...]], Score] = {}
    for score in scores:
        best.setdefault(score.term.key, score)
    return list(best.values())


def equal_constants(rig: DescribedRig, values: Mapping[str, float]) -> list[dict[str, float]]:
    """Return constants of linear rigs whose channels show the same, in steps along what they do not determine.

    The same but for damping, where an element has next to none. Where nothing can change little by little, others that
    show the same (`same_shown`).
    Nothing where they determine everything, or all but a factor of all forces.
    """
    names, random = [p.name for p in unknown(rig)], np.random.default_rng(SEED)
    flat = min((len(flat_directions(rig, names, random)) for _ in range(DRAWS)), default=0) if names else 0
    if not flat:
        return same_shown(rig, values)
    unknowns = Unknowns(rig, 1.0)
    damping = [p.name for p in unknowns.bent if p.unit == "N s/m"]
    least = LEAST_DAMPING * float(np.mean([values[name] for name in damping])) if damping else 0.0
    begun = unknowns.point({**values, **{name: max(values[name], least) for name in damping}})
    model = shown_by(unknowns, begun, random, WIDE)
    found: list[Real] = []
    for first in _moving(model, begun, flat):
        for sign in (1.0, -1.0):
            kept, at, along = begun, begun, sign * first
            for _ in range(STRIDES):
                after = _corrected(model, at + STRIDE * along, flat)
                if not (model.cost(after) <= EQUAL and along @ (after - at) > STRIDE / 2):
                    break
                at, along = after, _onward(model, after, flat, along)
                if float(np.abs((at - kept)[_moves(unknowns)]).max()) > APART:
                    found.append(at)
                    kept = at
    return [unknowns.constants(x) for x in found]


def _corrected(model: SpectralModel, x: Real, flat: int) -> Real:
    """Return the nearest point that spectra lead to, nothing moved along what they do not determine."""
    for _ in range(CORRECTIONS):
        off, slopes = model.evaluated(x)
        u, s, v = np.linalg.svd(slopes, full_matrices=False)
        told = max(s.size - flat, 0)
        x = x - v[:told].T @ ((u.T @ off)[:told] / np.maximum(s[:told], 1e-300))
    return x


def _moving(model: SpectralModel, x: Real, flat: int) -> Real:
    """Return (d, k) directions that spectra do not determine and in which motions change, one long in what moves."""
    basis = np.linalg.svd(model.evaluated(x)[1], full_matrices=True)[2][-flat:]
    moves = _moves(model.unknowns)
    if not moves.any():
        return np.empty((0, x.size))
    shapes = basis[:, moves]
    shapes = shapes - shapes.mean(axis=1, keepdims=True)
    u, s, _ = np.linalg.svd(shapes, full_matrices=False)
    rows = (u.T @ basis)[s > OWN]
    return np.asarray(rows / np.linalg.norm(rows[:, moves], axis=1, keepdims=True), np.float64)


def _moves(unknowns: Unknowns) -> NDArray[np.bool_]:
    """Return (k,) which constants are stiffnesses and masses: they make the shapes of motion."""
    return np.array([p.unit != "N s/m" for p in unknowns.bent] + [False] * len(unknowns.gains))


def _onward(model: SpectralModel, x: Real, flat: int, before: Real) -> Real:
    """Return the direction at a point that leads on from the one before."""
    rows = _moving(model, x, flat)
    if not len(rows):
        return before
    along = rows[int(np.argmax(np.abs(rows @ before)))]
    return np.asarray(math.copysign(1.0, float(along @ before)) * along, np.float64)
