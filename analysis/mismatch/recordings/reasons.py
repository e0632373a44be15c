"""Why a candidate that predicts what chooses better than the one that was accepted is not the one that is named.

Recordings do not choose by one error alone: all blocks that are not held out count, free parameters cost, time is not
preferred to amplitude in a single decay, and steady responses have a say.
"""

from __future__ import annotations

import math

from analysis.mismatch.recordings.blocks import mean_of
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.ranking import with_time
from analysis.mismatch.recordings.recorded import CHOOSE
from analysis.mismatch.selection import Candidate, SelectionStep
from sim_backend.mechanisms.kinds import ForceLaw

Step = SelectionStep[SimulatedFit]
Tried = Candidate[SimulatedFit]


def reason(judge: BlockJudge, step: Step, best: SimulatedFit, candidate: Tried) -> str:
    """Return why a candidate was not accepted although its error on the choosing blocks is smaller; empty if it is not.

    Parameters
    ----------
    best
        The fit with all that is named.
    """
    accepted = step.accepted
    if candidate is accepted or candidate.fit is None:
        return ""
    if accepted is None:
        smaller = mean_of(candidate.losses) < mean_of(step.before.by_block(CHOOSE))
        return _not_enough(judge, step, candidate) if smaller else ""
    return decided(judge, step, best, candidate) if mean_of(candidate.losses) < mean_of(accepted.losses) else ""


def with_what_else(candidate: Tried, best: Tried) -> str:
    """Name the best candidate, and say what else was at work where another one was compared with it."""
    name = best.id.replace("_", " ")
    alone, best_alone = (c.fit is None or len(c.fit.terms) < 2 for c in (candidate, best))
    if best_alone:
        return f"{name} alone"
    return f"{name} and what else is named" if alone else f"{name}, both beside what else is named"


def decided(judge: BlockJudge, step: Step, best: SimulatedFit, candidate: Tried) -> str:
    """Return what decided for the accepted candidate of a step and against another one."""
    accepted, policy = step.accepted, judge.problem.policy
    if accepted is None:
        return _not_enough(judge, step, candidate)
    what = accepted.id.replace("_", " ")
    if judge.problem.one_decay and with_time(candidate.mechanism) and not with_time(accepted.mechanism):
        if judge.steady is not None:
            return f"the steady responses, in which nothing changes with time, decided for {what}"
        ratio = math.sqrt(mean_of(candidate.losses) / max(mean_of(best.by_block(CHOOSE)), 1e-300))
        return (
            "amplitude and time go together in one decay: a change with time is preferred only where its error is "
            f"below {1 / math.sqrt(policy.in_time):.2g} times that of all that is named; it is {ratio:.3g} times"
        )
    steady = [step.steady.get(step.candidates.index(c)) for c in (candidate, accepted)]
    if steady[0] is not None and steady[1] is not None and steady[1] > steady[0]:
        return f"the steady responses decided for {what}, by an evidence of {steady[1] - steady[0]:.3g}"
    if candidate.fit is not None and candidate.fit.pinned():
        return (
            "a parameter of it ended at the end of its admissible range, which counts as an error "
            f"{math.sqrt(policy.in_time):.2g} times as large"
        )
    if candidate.evidence < accepted.evidence:
        less = accepted.evidence - candidate.evidence
        return (
            f"all blocks that are not held out choose, and free parameters cost: its evidence is {less:.2g} less than "
            f"that of {what}, {accepted.evidence:.4g}"
        )
    return f"what was accepted beside {what} made both together better than it"


def elsewhere(judge: BlockJudge, step: Step) -> str:
    """Say where else in the rig the mechanism that a step accepted explains nearly as much; empty if nowhere."""
    accepted, policy, rig = step.accepted, judge.problem.policy, judge.problem.arrangement
    if accepted is None:
        return ""
    least = accepted.evidence + policy.temperature * policy.told_apart
    own = accepted.mechanism.named(rig, accepted.score.term.place)
    alike = [c for c in step.candidates if c.fit is not None and c.id == accepted.id and c.evidence > least]
    places = dict.fromkeys(c.mechanism.named(rig, c.score.term.place) for c in alike)
    others = [name for name in places if name != own]
    if not others:
        return ""
    listed = f"{', '.join(others[:-1])} or {others[-1]}" if len(others) > 1 else others[0]
    return f" It may as well be at {listed} as at {own}: these recordings do not tell which."


def _not_enough(judge: BlockJudge, step: Step, candidate: Tried) -> str:
    before, after = mean_of(step.before.by_block(CHOOSE)), mean_of(candidate.losses)
    return (
        f"takes away {100 * (1 - after / before):.2g} % of the mean square; accepted is what does so by more than "
        f"chance and by {100 * judge.problem.policy.least_share:.2g} % at least"
    )


def not_tried(judge: BlockJudge, element: str) -> str:
    """Say which mechanisms the element would have to be described as another one for."""
    role = next((e.role for e in judge.problem.arrangement.elements if e.name == element), None)
    laws = {m.id: m for m in judge.known if isinstance(m, ForceLaw) and not m.preloaded}
    others = sorted(m.id.replace("_", " ") for m in laws.values() if role not in m.fits)
    if role is None or not others:
        return ""
    which = f"{', '.join(others[:-1])} and {others[-1]} were" if len(others) > 1 else f"{others[0]} was"
    return f" ({which} not tried, as the {element} is described as a {role})"
