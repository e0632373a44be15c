"""The selection of mechanisms for recordings of a described rig, made again where its first name may be wrong."""

from __future__ import annotations

from dataclasses import replace

from analysis.mismatch.recordings.blocks import missed_still
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.selection import Selection, screened_baseline, select


def select_for_recordings(judge: BlockJudge) -> Selection[SimulatedFit]:
    """Return what explains recordings best.

    Mechanisms are added one by one. Of two that are at work, a third that resembles both comes first; beside it neither
    gains enough. So where what is named leaves errors far over the noise, the selection is made once more without the
    first of the names, and what explains better counts.
    """
    found = select(judge, screened_baseline(judge))
    if found.chosen is None or not missed_still(found.baseline, found.chosen):
        return found
    first = found.chosen.terms[0].mechanism.id
    judge.on_progress(f"beginning again without {first.replace('_', ' ')}, which leaves much")
    others = judge.knowing([m for m in judge.known if m.id != first], judge.problem.policy)
    other = select(others, screened_baseline(others))
    lead = judge.evidence_of(other) - judge.evidence_of(found)
    if other.chosen is None or lead < judge.problem.policy.certain_by_blocks:
        return found
    return replace(other, judge=judge)
