"""Laws that nobody listed: the same selection once more, from families of laws in place of the catalogue.

Where nothing listed explains, or what is named leaves something beyond noise, a law is learned and competes with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.along_the_motion import LITTLE
from analysis.mismatch.ring_downs.candidates import screened_evidence
from analysis.mismatch.score_test import Screening
from analysis.mismatch.selection import (
    Candidate,
    Judge,
    Selection,
    SelectionStep,
    State,
    go_on,
    screened_baseline,
    select,
)
from sim_backend.learned.families import curves, learned_mechanisms
from sim_backend.learned.forms import FORM
from sim_backend.mechanisms.kinds import AddedBody, ForceLaw, Mechanism

SCATTER = 3.0  # standard deviations of chi-squared by which noise may hide that more is left


def is_learned(term: Term) -> bool:
    """Whether a term is a learned law, and no mechanism of the catalogue."""
    return FORM in term.values


@dataclass(slots=True)
class LearnedEarly:
    """A single law, learned as soon as few listed mechanisms do not explain; what was fitted for it serves later, too.

    It counts only where it leaves nothing: three listed mechanisms together, or two that begin with another one, are no
    likelier then than a law that nobody listed.

    Attributes
    ----------
    nearly
        Share of all that the linear rig misses, that the law may leave all the same.
    """

    nearly: float = 0.0
    problem: Any = None
    begun: State[Any] | None = None
    first: tuple[Candidate[Any], ...] = ()

    def __call__(self, selection: Selection[Any], to_beat: Any = None) -> Selection[Any] | None:
        """Return the selection of the law; None where it leaves something, or comes nowhere near a fit ``to_beat``."""
        learner, self.problem = _learner(selection, to_beat), selection.problem
        self.begun = _screened(learner, selection)
        self.first = learner.candidates(self.begun)
        if to_beat is not None and selection.judge.hopeless(self.first, selection):
            return None
        single = learner.knowing(learner.known, replace(learner.problem.policy, most_terms=1))
        found = select(single, self.begun, self.first)
        selection.judge.training.budget.spent = 0.0
        enough = _explains(found) or (_learned(found) and found.left.share < self.nearly)
        return _beside(found, selection) if enough and not _behind(found, selection) else None


def with_listed(found: Selection[Any], listed: Selection[Any]) -> Selection[Any] | None:
    """Return learned laws with what is listed among their rivals; None where that leaves nothing, or explains more."""
    explained = listed.chosen is not None and listed.left.p_value >= listed.problem.policy.level
    return None if explained or _behind(found, listed) else _beside(found, listed)


def with_one_law(selection: Selection[Any]) -> Selection[Any]:
    """Return one law that nobody listed in place of several listed ones in one element, if it explains no less.

    Two laws with free sizes imitate many a third one, of which one number more says what it is.
    """
    named = selection.chosen
    at = [e for t in (named.terms if named else ()) if isinstance(t.mechanism, ForceLaw) for e in t.place]
    if len(set(at)) == len(at) or _learned(selection):
        return selection
    return LearnedEarly()(selection, to_beat=named) or selection


def with_learned(selection: Selection[Any], early: LearnedEarly | None = None) -> Selection[Any]:
    """Return the selection of learned laws where it explains better than what is listed, else the selection itself.

    Nothing is learned where the linear rig leaves nothing beyond noise, nor where what is named leaves too little for a
    law to come near to replacing it. What is named counts as less likely the nearer a learned law comes to that. Of
    recordings whose noise is not known, what is named is contested only where it leaves something beyond it and errors
    clearly over it, or is a body that leaves something, and gives way only to laws that do not: a real rig's law is
    never quite that of any formula.

    Parameters
    ----------
    early
        What was learned already and serves again; a selection that it led to is returned as it is.
    """
    if _learned(selection):
        return selection
    judge, policy = selection.judge, selection.problem.policy
    named = selection.chosen
    noise_known = selection.problem.noise_known
    if selection.p_value >= policy.level or (named is not None and not noise_known and not judge.contested(selection)):
        return selection
    explained = judge.evidence_of(selection)
    least = max(policy.unnamed, policy.learned_share * explained)
    if named is not None and noise_known and _most_lead(named) < policy.learned_near * least:
        return selection
    learner = _learner(selection, to_beat=named if _single(named) else None)
    if named is not None and not _promises(learner.screen(named), policy.learned_promise, policy.serious * least):
        return selection
    if early is None or early.begun is None or early.problem is not selection.problem:
        begun, first = _screened(learner, selection), None
    else:
        begun, first = early.begun, early.first
    found = _found(learner, begun, selection, first)
    if found is None or not _learned(found) or (named is None and _behind(found, selection)):
        return selection
    if named is None:
        return _beside(found, selection)
    if not noise_known and not _explains(found):
        return selection
    lead = judge.lead(found, selection)
    if lead > least:
        return _beside(found, selection)
    unnamed = max(selection.left.unnamed, policy.unnamed * lead / least)
    return replace(selection, left=replace(selection.left, unnamed=unnamed))


def _found(
    learner: Judge[Any],
    begun: State[Any],
    selection: Selection[Any],
    first: tuple[Candidate[Any], ...] | None,
) -> Selection[Any] | None:
    """Return learned laws in place of the last name, else alone, else beside what is named; None if none comes near.

    Beside what is named, of recordings whose noise is not known alone: such a law must leave next to nothing.
    """
    named = selection.chosen
    if named is not None and not _single(named):
        found = _last_learned(learner, begun, selection)
        if found is not None:
            return found
    first = learner.candidates(begun) if first is None else first
    hopeless = _single(named) and selection.judge.hopeless(first, selection)
    found = None if hopeless else select(learner, begun, first)
    if named is None:
        missing = found is not None and found.chosen is None
    else:
        missing = not (found is not None and _explains(found)) and not selection.problem.noise_known
    if missing and selection.best.terms:
        further = go_on(learner, begun, State(selection.best, learner.screen(selection.best), selection.steps))
        return further if _learned(further) else found
    return found


def with_last_learned(selection: Selection[Any]) -> Selection[Any] | None:
    """Return a selection with a learned law in place of the mechanism accepted last; None if it leaves much."""
    if selection.chosen is None or _single(selection.chosen):
        return None
    learner = _learner(selection)
    found = _last_learned(learner, _screened(learner, selection), selection)
    return None if found is None else _beside(found, selection)


def _learner(selection: Selection[Any], to_beat: Any = None) -> Judge[Any]:
    """Return a judge that knows families of laws."""
    judge = selection.judge
    judge.on_progress("learning a law that nobody listed")
    judge.training.budget.spent = 0.0
    # a single force without a name is one of the families: it is no reason to name none of them
    anyhow = replace(selection.problem.policy, unnamed=math.inf)
    return judge.knowing(families_beside(selection), anyhow, to_beat=to_beat)


def families_beside(selection: Selection[Any]) -> list[Mechanism]:
    """Return the families of laws that may be learned in the place of what a selection names, or beside it.

    Of recordings, curves as well, but not where one name leaves little. Several names may be parts of one curve.
    """
    experiment = getattr(selection.problem, "experiment", None)  # recordings of a described rig have one load
    one_load = experiment is None or len(set(experiment.loads_n)) == 1
    laws = learned_mechanisms(one_load)
    if experiment is None and not (_single(selection.chosen) and selection.left.share <= LITTLE):
        laws += curves()
    if not selection.problem.noise_known:  # each candidate was fitted in full: a body that is listed, too
        listed = [k.extend for k in selection.judge.known if isinstance(k, AddedBody)]
        laws = [m for m in laws if not isinstance(m, AddedBody) or m.extend not in listed]
    return laws


def _screened(learner: Judge[Any], selection: Selection[Any]) -> State[Any]:
    """Return the linear rig screened for families of laws."""
    fresh = screened_baseline(learner)
    return State(fresh.current, replace(fresh.screening, p_value=selection.p_value))


def _last_learned(learner: Judge[Any], baseline: State[Any], selection: Selection[Any]) -> Selection[Any] | None:
    """See `with_last_learned`."""
    *before, last = selection.accepted
    found = go_on(learner, baseline, State(last.before, learner.screen(last.before), tuple(before)))
    return found if _explains(found) else None


def _learned(selection: Selection[Any]) -> bool:
    """Whether a selection names a learned law."""
    return selection.chosen is not None and any(map(is_learned, selection.chosen.terms))


def _explains(found: Selection[Any]) -> bool:
    """Whether a selection names a learned law and leaves nothing; of recordings whose noise is not known, near nothing.

    There a score test sees what the errors on held-out blocks hardly show: how inputs go on between samples, say.
    """
    nothing = found.left.p_value >= found.problem.policy.level
    return _learned(found) and (nothing or (not found.problem.noise_known and not found.judge.doubtful(found)))


def _behind(found: Selection[Any], listed: Selection[Any]) -> bool:
    """Whether learned laws explain less than what was listed, though that leaves something.

    Where the noise is not known it is what a fit leaves, and one that explains little can leave nothing beyond it.
    """
    return not listed.problem.noise_known and listed.judge.lead(found, listed) < 0


def _most_lead(named: Any) -> float:
    """Return the evidence by which another fit could lead at most: what is left beyond noise, and its scatter."""
    numbers = sum(r.size for r in named.residuals)
    return float(named.chi_squared) - numbers + SCATTER * math.sqrt(2 * numbers)


def _single(named: Any) -> bool:
    """Whether one mechanism alone is named."""
    return named is not None and len(named.terms) == 1


def _promises(screening: Screening, chance: float, least: float) -> bool:
    """Whether a law promises something beside what is named: by more than chance, and so much that it matters.

    One in the place of what is named can do no more than both together.
    """
    best = max((screened_evidence(score) for score in screening.scores), default=0.0)
    return screening.p_value < chance and best > least


def _beside(found: Selection[Any], listed: Selection[Any]) -> Selection[Any]:
    """Return a selection of learned laws with the listed mechanisms that were fitted among its candidates."""
    listed.judge.on_progress("looking at what the learned law leaves")
    found = replace(found, last_screening=listed.judge.screen(found.best))  # limits are those of what is listed
    if not listed.steps or found.chosen is None or not is_learned(found.chosen.terms[0]):
        return found
    first: SelectionStep[Any] = found.steps[0]
    ids = {c.id for c in first.candidates}
    others = [c for c in listed.steps[0].candidates if c.fit is not None and c.id not in ids]
    scores = sorted((*first.screening.scores, *listed.screening.scores), key=lambda s: -s.gain)
    first = replace(first, screening=replace(first.screening, scores=tuple(scores)))
    fitted = listed.judge.together(first.before, (*first.candidates, *others))
    accepted = first.accepted and next((c for c in fitted if c.score is first.accepted.score), first.accepted)
    return replace(found, steps=(replace(first, candidates=fitted, accepted=accepted), *found.steps[1:]))
