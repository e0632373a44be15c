"""The selection for impacts: with constants of its own for every impact where these scatter, without peculiar ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import pearsonr

from analysis.mismatch.answer import SetAside
from analysis.mismatch.chi_squared import evidence
from analysis.mismatch.problem import Constants, OnProgress
from analysis.mismatch.ring_downs.apart import apart, follow_strength, no_law_explains, set_aside, without
from analysis.mismatch.ring_downs.fit import Start, fit
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.ring_downs.problem import RingDownFit, RingDowns
from analysis.mismatch.selection import Selection, State, screened_baseline, select
from sim_backend.mechanisms.kinds import Mechanism

Found = tuple[Selection[RingDownFit], tuple[SetAside, ...]]
Begun = tuple[ImpactJudge, State[RingDownFit]]


def select_for_impacts(problem: RingDowns, known: Sequence[Mechanism], on_progress: OnProgress) -> Found:
    """Select mechanisms, and say which impacts were set aside because they show what no other one does.

    Few impacts are set aside where the linear rig explains all others and no law is near to what they show; or where
    nothing explains them all, but something the others, and they are not the strongest.
    """
    begun = _begun(problem, known, on_progress)
    state = begun[-1][1]
    if _consistent(begun):
        return select(*begun[-1]), ()
    odd = apart(state.current)
    rest = without(problem, _names(state.current, odd)) if odd else None
    if rest is not None and no_law_explains(state.current, state.screening, odd):
        on_progress("again, without what a few impacts alone show")
        others = _begun(rest, known, on_progress)
        if _consistent(others):
            return select(*others[-1]), set_aside(state.current, odd)
    found, last = _selected(begun)
    if found.chosen is not None:
        return found, ()
    return _without_odd_ones(problem, known, on_progress, last.best) or (found, ())


def _without_odd_ones(
    problem: RingDowns, known: Sequence[Mechanism], on_progress: OnProgress, best: RingDownFit
) -> Found | None:
    """Try again without the few impacts in which the best explanation leaves anything; None where that is no help.

    Impacts that are stronger than the others stay: what the rig does when tapped hard is no peculiarity.
    """
    odd = apart(best)
    rest = without(problem, _names(best, odd)) if odd and not follow_strength(best, odd) else None
    if rest is None:
        return None
    on_progress("again, without what a few impacts alone show")
    others = _begun(rest, known, on_progress)
    again = select(*others[-1]) if _consistent(others) else _selected(others)[0]
    explained = again.chosen is not None or _consistent(others)
    return (again, set_aside(best, odd)) if explained else None


def _names(fitted: RingDownFit, numbers: Sequence[int]) -> set[str]:
    return {fitted.segments[i].name for i in numbers}


def _begun(problem: RingDowns, known: Sequence[Mechanism], on_progress: OnProgress) -> tuple[Begun, ...]:
    """Return where a selection begins; the same with constants of its own for every impact where these scatter."""
    judge = ImpactJudge.of(problem, known, on_progress)
    baseline = screened_baseline(judge)
    if baseline.screening.p_value >= problem.policy.level or not scattered(baseline.current):
        return ((judge, baseline),)
    on_progress("again, with constants of its own for every impact")
    return (judge, baseline), _begun_for_each_impact(judge)


def _begun_for_each_impact(judge: ImpactJudge) -> Begun:
    other = ImpactJudge.of(judge.problem.per_impact_constants(), judge.known, judge.on_progress)
    return other, screened_baseline(other)


def _consistent(begun: tuple[Begun, ...]) -> bool:
    judge, state = begun[-1]
    return state.screening.p_value >= judge.problem.policy.level


def _selected(begun: tuple[Begun, ...]) -> tuple[Selection[RingDownFit], Selection[RingDownFit]]:
    """Select with constants of each load first, then with those of each impact; return what counts, and the last.

    A strong effect hides at first that the constants scatter: what it leaves beyond noise may be that.
    """
    judge = begun[0][0]
    plain = select(*begun[0])
    if plain.chosen is not None:
        if plain.left.p_value >= judge.problem.policy.level or not scattered(plain.chosen):
            return plain, plain
        judge.on_progress("again, with constants of its own for every impact")
        other, baseline = begun[1] if len(begun) > 1 else _begun_for_each_impact(judge)
        hint = replace(plain.chosen, constants=_own_constants(plain.chosen, judge.problem))
        again = select(replace(other, hints=(hint,)), baseline)
        better = again.chosen is not None and again.left.p_value > plain.left.p_value
        return (again, again) if better else (plain, plain)
    if len(begun) == 1:
        return plain, plain
    again = select(*begun[-1])
    # where nothing is named, what is said is said of the linear rig that explains more: scatter is not missing physics
    return (again if again.chosen is not None or again.p_value > plain.p_value else plain), again


def scattered(baseline: RingDownFit) -> bool:
    """Whether the contact's constants differ from impact to impact of a load by more than noise, and by chance.

    That is not missing physics: what differs must not follow the strength of the tap.
    """
    policy, segments = baseline.problem.policy, baseline.problem.experiment.segments
    if baseline.constants.load.shape[1] == 0 or baseline.problem.scattered:
        return False
    own = replace(baseline, constants=_own_constants(baseline, baseline.problem))
    start = Start(amplitudes=baseline.amplitudes if baseline.nonlinear else ())
    free = fit(baseline.problem.per_impact_constants(), baseline.terms, own, start)
    freed = (len(segments) - len(baseline.constants.load)) * baseline.constants.load.shape[1]
    if evidence(baseline.objective - free.objective, freed) < policy.scatter_evidence:
        return False
    stiffness = np.log(free.constants.load[:, 0])
    strength = np.array([math.log(float(np.abs(a).max())) for a in free.amplitudes])
    for group in range(len(baseline.constants.load)):
        at = [i for i, s in enumerate(segments) if s.group == group]
        stiffness[at] -= stiffness[at].mean()
        strength[at] -= strength[at].mean()
    return float(pearsonr(stiffness, strength).pvalue) > policy.level


def _own_constants(fitted: RingDownFit, problem: RingDowns) -> Constants:
    """Return a fit's constants with those of its loads for every impact of a problem."""
    groups = [s.group for s in problem.experiment.segments]
    return replace(fitted.constants, load=fitted.constants.load[groups])
