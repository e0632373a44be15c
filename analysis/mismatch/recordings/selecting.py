"""The selection of mechanisms for recordings of a described rig, made again where its first name may be wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from analysis.mismatch.recordings.blocks import mean_of, missed_still
from analysis.mismatch.recordings.costs import lead_of
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.ranking import with_time
from analysis.mismatch.recordings.recorded import HELD
from analysis.mismatch.recordings.start_check import worse_than_zero
from analysis.mismatch.selection import Selection, State, go_on, name_of, screened_baseline, select

FIRST = 2  # candidates beside which others are looked for where none is accepted
AGAIN = 2  # selections without the first names, at most
PREDICTED: Final = 0.25  # mean square held out beside that of the linear rig, which noise leaves at 1 (decision 172)


def select_for_recordings(judge: BlockJudge, put_right: bool = False) -> tuple[Selection[SimulatedFit], ...]:
    """Return what explains recordings best, then what else was named on the way to it.

    Mechanisms are added one by one. Of two that are at work, a third that resembles both comes first; beside it neither
    gains enough. So where what is named leaves errors far over the noise, or several names any that are clearly more,
    the selection is made again without the first of the names; then without the first that comes in its place too, and
    all that explain as much as that, until what explains best leaves no such errors. And where single samples are wrong
    beneath what is named, it is made again once these are ``put_right``; where a mechanism predicts what passed for
    noise of the inputs, without that.
    """
    found = _with_a_second(judge, select(judge, screened_baseline(judge)))
    beneath = found.baseline if found.chosen is None else found.best
    right = judge if put_right else judge.without_wrong_samples(beneath)
    if right is not judge:
        return select_for_recordings(right, put_right=True)
    if found.chosen is None:
        exact = _with_exact_inputs(judge, found)
        return (found,) if exact is judge else select_for_recordings(exact, put_right)
    tried, left_out = [found], {found.chosen.terms[0].mechanism.id}
    for _ in range(AGAIN):
        if not _leaves_much(tried[0]):
            break
        listed = ", ".join(sorted(left_out)).replace("_", " ")
        judge.on_progress(f"beginning again without {listed}, beside which much is left")
        others = judge.knowing([m for m in judge.known if m.id not in left_out], judge.problem.policy)
        other = replace(select(others, screened_baseline(others)), judge=judge)
        if not other.accepted:
            break
        if other.chosen is not None:
            tried = [other, *tried] if leads(other, tried[0]) else [*tried, other]
        left_out |= _first_names(other, other.best.terms[0].mechanism.id)
    return tuple(tried)


def _with_a_second(judge: BlockJudge, found: Selection[SimulatedFit]) -> Selection[SimulatedFit]:
    """Return what two mechanisms explain where neither is accepted alone, if all they leave is noise; else the same.

    Beside one of two strong ones so much is missed still, and so slowly, that what it explains may be chance.
    """
    policy, lasting = judge.problem.policy, not judge.problem.one_decay
    linear = judge.baseline()
    if found.accepted or not found.steps or worse_than_zero(linear, linear):
        return found
    begun, step = State(found.steps[0].before, found.screening), found.steps[0]
    sure = [
        c for c in step.candidates if c.evidence > policy.certain_by_blocks and (lasting or not with_time(c.mechanism))
    ]
    for first in sure[:FIRST]:
        if first.fit is not None:
            judge.on_progress(f"looking for what is at work beside {name_of(first.mechanism)}")
            steps = (replace(step, accepted=first),)
            both = go_on(judge, begun, State(first.fit, judge.screen(first.fit), steps))
            several = both.chosen is not None and len(both.chosen.terms) > 1
            if several and both.left.p_value >= policy.level:
                return both
    return found


def _leaves_much(found: Selection[SimulatedFit]) -> bool:
    """Whether what is named leaves errors far over the noise, or several names any that are clearly more."""
    if found.chosen is None:
        return False
    several = len(found.chosen.terms) > 1 and found.judge.doubtful(found)
    return several or bool(missed_still(found.baseline, found.chosen))


def _with_exact_inputs(judge: BlockJudge, found: Selection[SimulatedFit]) -> BlockJudge:
    """Return a judge to which inputs have no noise, where one mechanism predicts what passed for that; else the same.

    How much noise a measured input has, it does not tell for certain. What the rig makes of it is as slow as the rig,
    as a mismatch is, but no mechanism predicts it where it was not fitted.
    """
    problem, baseline = judge.problem, found.baseline
    scores = found.screening.scores
    if found.p_value < problem.policy.level or not problem.draws(baseline) or not scores:
        return judge
    if scores[0].gain - scores[0].dof < problem.policy.certain_by_blocks:
        return judge
    fitted = judge.fitted_alone(baseline, scores[:1])
    if fitted is None or mean_of(fitted.by_block(HELD)) > PREDICTED * mean_of(baseline.by_block(HELD)):
        return judge
    drives = tuple(replace(d, noise=0.0) for d in problem.rig.drives)
    exact = replace(problem, rig=replace(problem.rig, drives=drives))
    return BlockJudge.of(exact, judge.known, judge.on_progress, judge.sweeps)


def leads(one: Selection[SimulatedFit], other: Selection[SimulatedFit]) -> bool:
    """Whether one selection names what explains certainly better than what another one names."""
    return one.chosen is not None and lead_of(one.best, other.best) >= one.problem.policy.certain_by_blocks


def _first_names(found: Selection[SimulatedFit], first: str) -> set[str]:
    """Return the mechanism that was named first, and those whose evidence is not certainly less."""
    fitted = {c.id: c.evidence for c in reversed(found.steps[0].candidates) if c.fit is not None}
    least = fitted.get(first, math.inf) - found.problem.policy.certain_by_blocks
    return {first, *(i for i, evidence in fitted.items() if evidence > least)}
