"""The selection of mechanisms for recordings of a described rig, made again where its first name may be wrong."""

from __future__ import annotations

import math
from dataclasses import replace

from analysis.mismatch.recordings.blocks import likelihood_ratio, missed_still
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.selection import Selection, screened_baseline, select


def select_for_recordings(judge: BlockJudge) -> tuple[Selection[SimulatedFit], ...]:
    """Return what explains recordings best, then what else was named on the way to it.

    Mechanisms are added one by one. Of two that are at work, a third that resembles both comes first; beside it neither
    gains enough. So where what is named leaves errors far over the noise, the selection is made once more without the
    first of the names, and again without all that explain as much as it; what explains better counts.
    """
    found = select(judge, screened_baseline(judge))
    if found.chosen is None or not missed_still(found.baseline, found.chosen):
        return (found,)
    tried = [found]
    for left_out in _first_names(found, found.chosen.terms[0].mechanism.id, judge.problem.policy.certain_by_blocks):
        listed = " and ".join(sorted(left_out)).replace("_", " ")
        judge.on_progress(f"beginning again without {listed}, beside which much is left")
        others = judge.knowing([m for m in judge.known if m.id not in left_out], judge.problem.policy)
        other = replace(select(others, screened_baseline(others)), judge=judge)
        tried.append(other)
        if leads(other, found):
            break
    best = tried[-1] if leads(tried[-1], found) else found
    return (best, *(t for t in tried if t is not best and t.chosen is not None))


def leads(one: Selection[SimulatedFit], other: Selection[SimulatedFit]) -> bool:
    """Whether one selection names what explains certainly better than what another one names."""
    if one.chosen is None or not isinstance(one.judge, BlockJudge):
        return False
    return _lead(one.best, other.best) >= one.judge.problem.policy.certain_by_blocks


def _lead(one: SimulatedFit, other: SimulatedFit) -> float:
    """Return the evidence of one fit over another, in samples as independent as those of what the better one leaves."""
    more = sum(len(t.mechanism.parameters) for t in one.terms) - sum(len(t.mechanism.parameters) for t in other.terms)
    better = min(one, other, key=lambda f: f.scatter)
    return likelihood_ratio(other, one, better) - one.problem.policy.parameter_cost * more


def _first_names(found: Selection[SimulatedFit], first: str, certain: float) -> list[set[str]]:
    """Return the mechanism that was named first, then with it those whose evidence is not certainly less."""
    fitted = {c.id: c.evidence for c in reversed(found.steps[0].candidates) if c.fit is not None}
    alike = {first, *(i for i, evidence in fitted.items() if evidence > fitted.get(first, math.inf) - certain)}
    return [{first}] if alike == {first} else [{first}, alike]
