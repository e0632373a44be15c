"""Accepted mechanisms weighed again beside those that were accepted after them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from analysis.mismatch.recordings.blocks import likelihood_ratio, of_least_noise
from analysis.mismatch.recordings.costs import cost_of
from analysis.mismatch.recordings.fit import SimulatedFit, fit
from analysis.mismatch.recordings.racing import certainly_worse, weight_of
from analysis.mismatch.recordings.ranking import with_time
from analysis.mismatch.recordings.recorded import CHOOSE
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate, SelectionStep
from sim_backend.mechanisms.kinds import AddedBody

OTHERS = 2  # that are fitted in the place of an accepted mechanism

Steps = tuple[SelectionStep[SimulatedFit], ...]
Tried = Candidate[SimulatedFit]


def weighed_together(before: SimulatedFit, fits: Sequence[tuple[Score, SimulatedFit]]) -> list[Tried]:
    """Return candidates, the best first, by the likelihood ratio of all that is not held out.

    What happens once, in a block that is fitted, no choosing block can show.
    """
    if not fits:
        return []
    best = of_least_noise((f for _, f in fits), weight_of)
    found: list[Tried] = []
    for score, fitted in fits:
        evidence = likelihood_ratio(before, fitted, best, weight_of(fitted)) - cost_of(fitted, fitted.terms[-1])
        found.append(Candidate(score, fitted, evidence, losses=fitted.by_block(CHOOSE)))
    return sorted(found, key=lambda c: -c.evidence)


def without_idle_ones(current: SimulatedFit, steps: Steps) -> tuple[SimulatedFit, Steps]:
    """Leave out mechanisms that stood in for later ones: without them all blocks are predicted as well."""
    taken = [k for k, step in enumerate(steps) if step.accepted is not None]
    for i in range(len(current.terms) - 1):
        lean = fit(current.problem, current.terms[:i] + current.terms[i + 1 :], current, fine=True)
        if likelihood_ratio(lean, current, current) < current.problem.policy.certain_by_blocks:
            kept = [step for k, step in enumerate(steps) if k != taken[i]]
            kept[0] = replace(kept[0], before=steps[0].before)
            return without_idle_ones(lean, tuple(kept))
    return current, steps


def exchanged(current: SimulatedFit, steps: Steps) -> tuple[SimulatedFit, Steps]:
    """Return the best fit, and its steps, with each mechanism or with another in its place that was as likely alone.

    Alone, what the others make was missing beside each of them: what then seemed alike may be told apart now.
    """
    taken, begun = [k for k, step in enumerate(steps) if step.accepted is not None], current
    if len(current.terms) < 2 or len(taken) != len(current.terms):
        return current, steps
    for i, k in enumerate(taken):
        alike = _alike(steps[k], current)
        if alike:
            current, step = _weighed(current, i, steps[k], alike)
            steps = (*steps[:k], step, *steps[k + 1 :])
    if current is begun:
        return current, steps
    for i, k in enumerate(taken[1:], 1):
        before = fit(current.problem, current.terms[:i], steps[k].before, fine=True)
        steps = (*steps[:k], replace(steps[k], before=before), *steps[k + 1 :])
    return current, steps


def _alike(step: SelectionStep[SimulatedFit], current: SimulatedFit) -> list[Tried]:
    """Return candidates of a step that are not at work yet and explained nearly as much as the accepted one."""
    problem, policy = current.problem, current.problem.policy
    accepted = step.accepted.evidence if step.accepted is not None else 0.0
    least = min(policy.hopeful * accepted, accepted - policy.certain_by_blocks)
    working = {t.key for t in current.terms}
    others = (c for c in step.candidates if c.fit is not None and c.score.term.key not in working)
    lasting = (c for c in others if not (problem.one_decay and with_time(c.mechanism)))
    return [c for c in lasting if c.evidence > least][:OTHERS]


def _weighed(
    current: SimulatedFit, i: int, step: SelectionStep[SimulatedFit], alike: list[Tried]
) -> tuple[SimulatedFit, SelectionStep[SimulatedFit]]:
    """Fit each in the place of term ``i``; return the best fit, and the step with what each explains there."""
    problem, terms, accepted = current.problem, current.terms, step.accepted
    fits = {id(accepted): current}
    for c in alike:
        if c.fit is not None:
            term = next(t for t in c.fit.terms if t.key == c.score.term.key)
            to_beat = math.inf if isinstance(term.mechanism, AddedBody) else certainly_worse(current)
            fits[id(c)] = fit(problem, (*terms[:i], term, *terms[i + 1 :]), current, fine=True, to_beat=to_beat)
    best = of_least_noise(fits.values())
    without = fit(problem, (*terms[:i], *terms[i + 1 :]), current, fine=True)

    def again(c: Tried) -> Tried:
        fitted = fits[id(c)]
        cost = cost_of(fitted, fitted.terms[i])
        return replace(
            c, fit=fitted, evidence=likelihood_ratio(without, fitted, best) - cost, losses=fitted.by_block(CHOOSE)
        )

    weighed = {id(c): again(c) for c in step.candidates if id(c) in fits}
    chosen = next(c for c in weighed.values() if c.fit is best)
    # what is not weighed again stays at least as far behind as it was
    fallen = min(weighed[id(accepted)].evidence - accepted.evidence, 0.0) if accepted is not None else 0.0
    others = {id(c): replace(c, evidence=c.evidence + fallen) for c in step.candidates if id(c) not in fits}
    found = [{**others, **weighed}[id(c)] for c in step.candidates]
    candidates = sorted(found, key=lambda c: (c.fit is None, -c.evidence))
    return best, replace(step, candidates=tuple(candidates), accepted=chosen, steady={})
