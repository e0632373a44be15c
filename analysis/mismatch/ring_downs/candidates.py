"""Full fits of candidates to ring-downs: where they begin, which of several minima counts, what they gain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from analysis.mismatch.chi_squared import evidence
from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs.continuation import (
    FIRST_S,
    beginnings,
    continued,
    each_alone,
    lengthened,
    scales_kept,
)
from analysis.mismatch.ring_downs.coordinates import admissible
from analysis.mismatch.ring_downs.fit import (
    COMPETING_ITERATIONS,
    CONVERGED,
    Complex,
    Start,
    Stop,
    fit,
    objective_with,
    without_added,
)
from analysis.mismatch.ring_downs.problem import RingDownFit, RingDowns
from analysis.mismatch.score_test import Score, screen
from analysis.mismatch.selection import Candidate, SelectionStep, started
from sim_backend.mechanisms.kinds import AddedBody, ForceLaw, Mechanism, Tones

ABRUPT_STEPS, MOST_ABRUPT_STEPS = (3.0, 1.5, 1.15), 8  # factors by which a jump's rounding is changed, how often each
FINER, MOST_SUBSTEPS = 2, 16  # factor by which a sample's substeps are refined, and how many there are at most
STEPPED = 1.0  # change of chi-squared with finer steps from which on these are needed

Steps = tuple[SelectionStep[RingDownFit], ...]
Begin = tuple[Term, RingDownFit | None]
"""Values of a term, and the fit whose rig it starts from; None for the rig as declared."""


def screened_evidence(score: Score) -> float:
    """Return the evidence that a score promises."""
    return evidence(score.gain, score.own_numbers)


def variants(scores: Sequence[Score], hopeful: float) -> list[Score]:
    """Return the best score with each set of fixed values in a mechanism, where it is not far behind the first."""
    best: dict[frozenset[tuple[str, float]], Score] = {}
    for score in scores:
        best.setdefault(frozenset(score.term.fixed.items()), score)
    least = hopeful * screened_evidence(scores[0])
    return [s for s in best.values() if s is scores[0] or screened_evidence(s) > least]


def fitted_candidate(
    current: RingDownFit, score: Score, starts: Sequence[Begin], to_beat: float
) -> Candidate[RingDownFit]:
    """Return the best of the full fits of a mechanism that begin at these values and rigs.

    Parameters
    ----------
    to_beat
        Objective from which on a fit is given up.
    """
    fitted = _best(current.problem, current.terms, starts, score.delays, to_beat)
    if fitted is None or not rings(fitted):
        return Candidate(score, None, 0.0)
    found = _judged(current, fitted, score, _own_numbers(current, fitted, score))
    if score.term.phase_locked and current.objective - fitted.objective > current.problem.policy.phase_locked_most:
        found = max(found, *_freed(current, fitted, score), key=lambda c: c.evidence)
    return found


def explains(current: RingDownFit, candidate: Candidate[RingDownFit]) -> bool:
    """Whether a candidate was fitted and leaves so little of what the current fit misses that it cannot be lost."""
    fitted = candidate.fit
    if fitted is None:
        return False
    policy, missed = fitted.problem.policy, max(current.reduced_chi_squared - 1, 0.0)
    return fitted.reduced_chi_squared < max(policy.strong, 1 + policy.may_be_left(1) * missed)


def lengthened_candidate(
    current: RingDownFit, score: Score, begin: RingDownFit, to_beat: float
) -> Candidate[RingDownFit]:
    """Return the fit of a force law that is begun with one of the first milliseconds."""
    stop = Stop(COMPETING_ITERATIONS, competing=True, against=current.objective, to_beat=to_beat)
    with suppress(ValueError, np.linalg.LinAlgError):
        fitted = lengthened(current.problem, begin.terms, begin, stop)
        return _judged(current, fitted, score, score.own_numbers)
    return Candidate(score, None, 0.0)


def continued_candidate(current: RingDownFit, candidate: Candidate[RingDownFit]) -> Candidate[RingDownFit]:
    """Look for a law by continuation: its fit may be lost because it is strong."""
    fitted = candidate.fit
    if fitted is None or not fitted.only_laws:
        return candidate
    with suppress(ValueError, np.linalg.LinAlgError):
        again = continued(current.problem, fitted.terms, current)
        if again is not None:
            return _judged(current, again, candidate.score, candidate.own)
    return candidate


def _judged(current: RingDownFit, fitted: RingDownFit, score: Score, own: int) -> Candidate[RingDownFit]:
    gain = current.objective - fitted.objective - score.choice
    parameters, cost = len(score.term.mechanism.parameters), current.problem.policy.parameter_cost
    return Candidate(score, fitted, evidence(gain, own, parameters, cost), own)


def _own_numbers(current: RingDownFit, fitted: RingDownFit, score: Score) -> int:
    """Return how many numbers of a candidate are free in the segments; of an added body, as many as its modes have."""
    if not isinstance(score.term.mechanism, AddedBody):
        return score.own_numbers
    after, before = ([f.modes[s.group].coefficients for s in f.segments] for f in (fitted, current))
    return sum(after) - sum(before)


def _freed(current: RingDownFit, locked: RingDownFit, score: Score) -> list[Candidate[RingDownFit]]:
    """Fit an added body that rings in every segment as it will: phase-locked to the tap it is only nearly.

    Locked again it may end in a deeper minimum: from where it came free, and from there with the declared rig.
    """
    problem, others, delays = current.problem, locked.terms[:-1], score.delays
    free = competing(problem, (*others, replace(started(score), freed=True)), current, delays)
    again = competing(problem, (*others, replace(free.terms[-1], freed=False)), free, delays)
    declared = competing(problem, again.terms, None, delays)
    own = score.own_numbers
    judged = [_judged(current, fitted, score, own) for fitted in (again, declared) if rings(fitted)]
    return [_judged(current, free, score, 2 * len(current.segments)), *judged]


def _best(
    problem: RingDowns,
    others: tuple[Term, ...],
    starts: Sequence[Begin],
    delays: Sequence[float] = (),
    to_beat: float = math.inf,
) -> RingDownFit | None:
    """Fit a term beside others from some values and rigs, for a few steps each; continue with the best."""
    fits: list[RingDownFit] = []
    for term, begin in starts:
        least = min([to_beat, *(f.objective for f in fits if rings(f))])
        with suppress(ValueError, np.linalg.LinAlgError):  # it cannot be joined with what is there already
            fits.append(competing(problem, (*others, term), begin, delays, least))
    best = min(fits, key=lambda f: (not rings(f), f.objective), default=None)
    if best is None or best.nonlinear or best.objective > to_beat:
        return best
    return fit(problem, best.terms, best, stop=Stop(competing=True))


def rings(fitted: RingDownFit) -> bool:
    """Whether the bodies that were added are admissible ones."""
    return all(admissible(t, fitted.constants.at(0)) for t in fitted.terms)


def competing(
    problem: RingDowns,
    terms: Sequence[Term],
    begin: RingDownFit | None,
    delays: Sequence[float] = (),
    to_beat: float = math.inf,
) -> RingDownFit:
    """Fit a model so well that it can be compared with others.

    Beside force laws it starts from the amplitudes that these left; where a body changes the modes, from those that it
    leaves to each segment alone, as the linear rig's are far off.
    """
    amplitudes: Sequence[Complex] = ()
    if begin is not None and begin.nonlinear and len(terms) > len(begin.terms):
        bodies = [sum(isinstance(t.mechanism, AddedBody) for t in some) for some in (terms, begin.terms)]
        if bodies[0] == bodies[1]:
            amplitudes = begin.amplitudes
        elif begin.only_laws:
            amplitudes = each_alone(beginnings(problem, FIRST_S), terms, begin)
    start = Start(delays=delays, amplitudes=amplitudes)
    return fit(problem, terms, begin, start, Stop(COMPETING_ITERATIONS, competing=True, to_beat=to_beat))


def converged(fitted: RingDownFit) -> RingDownFit:
    """Go on with a fit until no step gains anything, and finer steps of its extra forces change nothing."""
    if fitted.nonlinear:  # while it competed it was computed in coarser steps
        found = fit(fitted.problem, fitted.terms, fitted, Start(amplitudes=fitted.amplitudes))
        terms = as_abrupt_as_recorded(found)
        if terms != found.terms:
            found = fit(found.problem, terms, found, Start(amplitudes=found.amplitudes))
        while found.added().propagated and found.substeps < MOST_SUBSTEPS:
            finer = replace(found, substeps=FINER * found.substeps)
            if abs(objective_with(finer, found.terms) - found.objective) < STEPPED:
                break
            found = fit(found.problem, found.terms, finer, Start(amplitudes=found.amplitudes))
        return _with_scales_found_again(found)
    found = fit(fitted.problem, fitted.terms, fitted)
    return found if found.objective < fitted.objective else fitted


def _with_scales_found_again(fitted: RingDownFit) -> RingDownFit:
    """Return the better of a fit that moved masses or loads far and one that begins again with these as declared.

    Recordings hardly tell them, so that what moved them once, a fit of another model or a coarser one, may stay.
    """
    kept = scales_kept(fitted) if fitted.only_laws else None
    if kept is None:
        return fitted
    again = fit(fitted.problem, kept.terms, kept, Start(amplitudes=kept.amplitudes))
    return min(fitted, again, key=lambda one: one.objective)


def as_abrupt_as_recorded(fitted: RingDownFit) -> tuple[Term, ...]:
    """Return the terms with jumps rounded off as the recordings have it: trials begin with a few values of it alone.

    A wrong one would be left over as if something else were at work, and the law's strength would make up for it.
    """
    terms, best = fitted.terms, fitted.objective
    for i, name in enumerate(t.mechanism.rounding if isinstance(t.mechanism, ForceLaw) else "" for t in terms):
        for factor in [f for s in ABRUPT_STEPS for f in (1 / s, s)] if name else ():
            for _ in range(MOST_ABRUPT_STEPS):
                moved = terms[i].moved({name: factor * terms[i].values[name]})
                tried = (*terms[:i], moved, *terms[i + 1 :])
                objective = objective_with(fitted, tried)
                if not objective < best - CONVERGED:
                    break
                terms, best = tried, objective
    return terms


def elsewhere(current: RingDownFit, scores: Sequence[Score]) -> list[Begin]:
    """Return where else the fit of an added body, which has more than one minimum, is started.

    At its next best screened values. Beside laws, at the best of the fits that leave what these add to the segments as
    it is.
    """
    policy = current.problem.policy
    least = policy.other_start * screened_evidence(scores[0])
    starts: list[Begin] = [(started(s), current) for s in scores[: policy.starts] if screened_evidence(s) > least]
    if not current.nonlinear:
        return starts[1:]
    linear = tuple(t for t in current.terms if not t.nonlinear)
    best = _best(without_added(current), linear, starts)
    return [] if best is None else [(best.terms[-1], best)]


def looked_for_again(current: RingDownFit) -> RingDownFit:
    """Restart each earlier mechanism beside the later ones: alone, it may have drifted far to stand in for them."""
    fitted = current
    for i, term in enumerate(current.terms[:-1]):
        if isinstance(term.mechanism, Tones):
            continue
        others = fitted.terms[:i] + fitted.terms[i + 1 :]
        with suppress(ValueError, np.linalg.LinAlgError):
            without = competing(fitted.problem, others, fitted)
            scores = [s for s in screen(fitted.problem, without, [term.mechanism]).scores if s.term.place == term.place]
            score = max(scores, key=screened_evidence)
            terms = (*others[:i], started(score), *others[i:])
            found = competing(fitted.problem, terms, without, score.delays)
            if found.objective < fitted.objective - fitted.problem.policy.least_gain and rings(found):
                fitted = min(converged(found), fitted, key=lambda f: f.objective)
    return fitted


def without_idle_ones(fitted: RingDownFit, steps: Steps) -> tuple[RingDownFit, Steps]:
    """Leave out earlier mechanisms that gain little beside the later ones: alone they only stood in for these."""
    kept, policy = list(steps), fitted.problem.policy
    for place in reversed([i for i, s in enumerate(steps) if s.accepted is not None][:-1]):
        candidate = kept[place].accepted
        if candidate is None:
            continue
        at = sum(s.accepted is not None for s in kept[:place])
        others = fitted.terms[:at] + fitted.terms[at + 1 :]
        with suppress(ValueError, np.linalg.LinAlgError):
            without = converged(competing(fitted.problem, others, fitted))
            gain = without.objective - fitted.objective
            if evidence(gain, candidate.own, len(candidate.mechanism.parameters)) < policy.least_gain:
                fitted, kept[place] = without, replace(kept[place], accepted=None)
    return fitted, tuple(kept)


def with_stiffness(candidate: Candidate[RingDownFit]) -> float:
    """Return the evidence of the impacts and of how k_c grows with the load."""
    return candidate.evidence + stiffness_evidence(candidate.mechanism, candidate.fit)


def stiffness_evidence(mechanism: Mechanism, fitted: RingDownFit | None) -> float:
    """Chi-squared by which k_c(P) speaks against a force law of the contact: its exponent must be the law's."""
    exponent = stiffness_exponent(fitted) if fitted is not None else None
    if not isinstance(mechanism, ForceLaw) or mechanism.stiffness_exponent is None or exponent is None:
        return 0.0
    expected, tolerance = mechanism.stiffness_exponent
    return -(((exponent[0] - expected) / math.hypot(tolerance, exponent[1])) ** 2)


def stiffness_exponent(fitted: RingDownFit) -> tuple[float, float] | None:
    """Return d ln k_c / d ln P over the loads and its standard error; None with less than three loads."""
    loads = np.log(np.array(fitted.problem.experiment.loads_n))
    names = fitted.constants.names()[1]
    if "kc" not in names or loads.size < 3 or np.ptp(loads) < 0.1:
        return None
    y = np.log(fitted.constants.load[:, names.index("kc")])
    x = loads - loads.mean()
    slope = float(x @ y / (x @ x))
    scatter = y - y.mean() - slope * x
    return slope, math.sqrt(float(scatter @ scatter) / (loads.size - 2) / float(x @ x))
