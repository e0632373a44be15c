"""The diagnosis of an experiment: what was left out of the rig, where, how sure, what is left over, what comes next.

One path for every rig: impacts of a session or recordings of whatever a description says, the same selection, the same
answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from analysis.mismatch.account import Account, beyond_noise
from analysis.mismatch.answer import Answer, Named, RecordingFile, Remainder, UpperLimit, Verdict
from analysis.mismatch.law_reading import law_of
from analysis.mismatch.learning import (
    LearnedEarly,
    is_learned,
    with_last_learned,
    with_learned,
    with_listed,
    with_one_law,
)
from analysis.mismatch.limits import complete_probability, upper_limits
from analysis.mismatch.problem import OnProgress, silent
from analysis.mismatch.recordings.account import BlockAccount
from analysis.mismatch.recordings.along_the_motion import one_law_tells, with_largest_fitted
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.recordings.selecting import leads, select_for_recordings
from analysis.mismatch.recordings.start_check import frame_remark
from analysis.mismatch.recordings.steady import Sweep
from analysis.mismatch.recordings.wrong_samples import set_aside
from analysis.mismatch.remainder import remainder_statement
from analysis.mismatch.rig_description import DescribedRig
from analysis.mismatch.ring_downs.account import ImpactAccount
from analysis.mismatch.ring_downs.load_drift import with_load_drift
from analysis.mismatch.ring_downs.problem import RingDowns
from analysis.mismatch.ring_downs.selecting import select_for_impacts
from analysis.mismatch.ring_downs.sessions import ring_downs
from analysis.mismatch.rivals import rivals_of
from analysis.mismatch.selection import Selection, screened_baseline, select
from analysis.session import AnalysisError
from daq.exchange import Recording
from daq.records import Session
from sim_backend.learned.families import form_named, learned_mechanisms
from sim_backend.mechanisms.kinds import ForceLaw, Mechanism

NEARLY = 1e-3  # of what the linear rig misses: what one law may leave where several listed ones are not sought


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """An answer and the selection behind it."""

    answer: Answer
    selection: Selection[Any]


def diagnose(
    problem: RingDowns | SimulatedRecordings,
    known: Sequence[Mechanism],
    on_progress: OnProgress = silent,
    recordings: Sequence[RecordingFile] = (),
    sweeps: Sequence[Sweep] = (),
    learn: bool = True,
) -> Diagnosis:
    """Find out what physics a rig lacks to explain an experiment's recordings.

    Parameters
    ----------
    problem
        From `analysis.mismatch.ring_downs.sessions` or `analysis.mismatch.simulated.problem_of`.
    known
        Mechanisms that may be named.
    on_progress
        Called with what is being done.
    recordings
        The files that were read, for the answer.
    sweeps
        Steady responses of the same rig.
    learn
        Whether laws that nobody listed compete with what is listed.
    """
    # the matrices are small: further threads of the linear algebra would only get in each other's way; trial steps of a
    # fit that lead nowhere may overflow
    with threadpool_limits(limits=1, user_api="blas"), np.errstate(all="ignore"):
        if isinstance(problem, RingDowns):
            early = LearnedEarly() if learn else None
            selection, odd = select_for_impacts(problem, known, on_progress, early)
            selection = selection if early is None else with_learned(selection, early)
            on_progress("comparing with the held-out impacts")
            answer = answer_of(ImpactAccount(selection), recordings)
            return Diagnosis(replace(answer, set_aside=odd), selection)
        judge = BlockJudge.of(problem, known, on_progress, sweeps)
        one = _one_law_that_tells(judge) if learn else None
        found = _of_all(judge, learn) if one is None else one
        on_progress("comparing with what was held out")
        answer = answer_of(BlockAccount(found), recordings)
        return Diagnosis(replace(answer, set_aside=set_aside(found.best)), found)


def _of_all(judge: BlockJudge, learn: bool) -> Selection[SimulatedFit]:
    """Return what explains recordings best: what is listed, several of it together, and what is learned."""
    found, *others = select_for_recordings(judge)
    return _with_learned_of_any(found, others) if learn and _described_rightly(BlockAccount(found)) else found


def _one_law_that_tells(judge: BlockJudge) -> Selection[SimulatedFit] | None:
    """Return one learned law where along the motion it alone leaves next to nothing, and no one listed explains.

    Several listed mechanisms would be fitted in vain (decision 187).
    """
    begun = screened_baseline(judge)
    if begun.screening.p_value >= judge.problem.policy.level:
        return None
    judge.on_progress("looking along the motion")
    if not one_law_tells(begun.current, judge.known, learned_mechanisms(one_load=True)):
        return None
    if BlockAccount(judge.outcome(begun, begun)).described_otherwise() is not None:
        return None
    divided = with_largest_fitted(begun.current)
    if divided is not judge.problem:
        judge = BlockJudge.of(divided, judge.known, judge.on_progress, judge.sweeps)
        begun = screened_baseline(judge)
    found = LearnedEarly(nearly=NEARLY)(judge.outcome(begun, begun))
    if found is None:
        return None
    alone = replace(judge.problem.policy, most_terms=1)
    return with_listed(found, select(judge.knowing(judge.known, alone, to_beat=found.best), begun))


def _with_learned_of_any(
    found: Selection[SimulatedFit], others: Sequence[Selection[SimulatedFit]]
) -> Selection[SimulatedFit]:
    """Return what learned laws make of what explains best; where much of it is left, of what else was named too.

    What is named beside a law that nobody listed may explain less, without it, than something that resembles both.
    """
    best = with_one_law(with_learned(found))
    for other in others:
        if best.left.p_value >= best.problem.policy.level:
            break
        learned = with_last_learned(other)
        if learned is not None and leads(learned, best):
            best = learned
    return best


def _described_rightly(account: BlockAccount) -> bool:
    """Whether no other constant of the rig, and no other hold of its inputs, explains what nothing listed does.

    A law that is learned would take the place of what was described wrongly.
    """
    selection = account.selection
    if selection.chosen is not None or selection.p_value >= selection.problem.policy.level:
        return True
    return not account.far_off and account.described_otherwise() is None


def diagnose_sessions(
    sessions: Sequence[Session],
    rig: DescribedRig,
    uncertainty: Mapping[str, float],
    known: Sequence[Mechanism],
    on_progress: OnProgress = silent,
    recordings: Sequence[RecordingFile] = (),
    learn: bool = True,
) -> Diagnosis:
    """Diagnose a session of impacts, or several of one rig together; their calibrations count as well.

    Parameters
    ----------
    rig, uncertainty
        Description that they are compared with, and standard errors of the constants that their header declares.

    Raises
    ------
    AnalysisError
        The sessions cannot carry a diagnosis.

    Examples
    --------
    >>> from daq.session_file import read_session  # doctest: +SKIP
    >>> from mesotap.configuration.declared import header_uncertainty  # doctest: +SKIP
    >>> from mesotap.configuration.rig_files import tester_rig  # doctest: +SKIP
    >>> from sim_backend.mechanisms.catalogue import catalogue, variants  # doctest: +SKIP
    >>> session = read_session("session.h5")  # doctest: +SKIP
    >>> rig, uncertainty = tester_rig(), header_uncertainty(session)  # doctest: +SKIP
    >>> found = diagnose_sessions([session], rig, uncertainty, variants(catalogue()))  # doctest: +SKIP
    >>> found.answer.verdict, [m.id for m in found.answer.mechanisms]  # doctest: +SKIP
    """
    on_progress("identifying the modes of each impact")
    problem = ring_downs(sessions, rig, uncertainty)
    found = diagnose(problem, known, on_progress, recordings, learn=learn)
    return replace(found, answer=with_load_drift(found.answer, sessions, known, problem.policy.level))


def diagnose_recordings(
    recordings: Sequence[Recording],
    rig: DescribedRig,
    known: Sequence[Mechanism],
    on_progress: OnProgress = silent,
    files: Sequence[RecordingFile] = (),
    sweeps: Sequence[Sweep] = (),
    learn: bool = True,
) -> Diagnosis:
    """Diagnose recordings of a described rig, with measured inputs or after a tap that was not.

    Parameters
    ----------
    sweeps
        Steady responses of the same rig.

    Raises
    ------
    AnalysisError
        The recordings cannot carry a diagnosis of this rig.

    Examples
    --------
    >>> found = diagnose_recordings([recording], rig, variants(catalogue()))  # doctest: +SKIP
    >>> found.answer.verdict, [m.id for m in found.answer.mechanisms]  # doctest: +SKIP
    """
    source = ", ".join(r.source for r in recordings)
    try:
        with threadpool_limits(limits=1, user_api="blas"), np.errstate(all="ignore"):
            problem = problem_of(rig, [prepare(r, rig) for r in recordings])
            if remark := frame_remark(rig, recordings):
                raise AnalysisError(f"{source}: {remark}")
        return diagnose(problem, known, on_progress, files, sweeps, learn)
    except (np.linalg.LinAlgError, ArithmeticError) as error:
        raise AnalysisError(
            f"{source}: cannot be computed with the rig {rig.name!r} as described: its constants or its times are "
            "far from what was recorded; check their units"
        ) from error


def answer_of(account: Account[Any], recordings: Sequence[RecordingFile] = ()) -> Answer:
    """Return what a selection says."""
    selection, policy = account.selection, account.selection.problem.policy
    chosen = selection.chosen
    far_off = account.far_off
    found = selection.p_value < policy.level or far_off
    verdict: Verdict = "consistent" if not found else "unexplained" if chosen is None else "missing_physics"
    named = [] if chosen is None else [_named(account, chosen, i) for i in range(len(selection.accepted))]
    if verdict == "missing_physics" and any(m.learned for m in named):
        verdict = "new_physics"
    otherwise = account.described_otherwise() if verdict == "unexplained" else None
    location = account.location(named, otherwise) if found else None
    remainder = _remainder(account, verdict)
    if verdict == "unexplained" and location is not None:
        statement = location.why if far_off or otherwise is not None else remainder.statement
        remainder = replace(remainder, where=location, statement=statement)
    return Answer(
        recordings=tuple(recordings),
        rig=selection.problem.name,
        verdict=verdict,
        p_value=selection.p_value,
        mechanisms=tuple(named),
        complete_probability=complete_probability([m.probability for m in named], remainder.p_value),
        remainder=remainder,
        upper_limits=_upper_limits(account, named),
        rivals=rivals_of(account, otherwise),
        location=location,
        fit=account.summary(chosen),
        next_experiment=account.next_experiment(named) if found and otherwise is None else None,
        loads_n=account.groups,
        far_off=far_off,
        fitted=account.fitted(),
        decay=account.decay,
        worse_than_zero=account.worse_than_zero,
        otherwise="" if otherwise is None else otherwise.said,
    )


def _named(account: Account[Any], chosen: Any, number: int) -> Named:
    """Return what is said of a mechanism that was accepted; of a learned one with its law."""
    named = account.named(chosen, number)
    if not is_learned(chosen.terms[number]):
        return named
    account.selection.judge.on_progress("reading the learned law")
    law = law_of(account, chosen, number, named.parameters)
    named = replace(named, learned=True, law=law)
    if not law.formulas or not isinstance(chosen.terms[number].mechanism, ForceLaw):
        return named
    best = law.formulas[0]  # it may be simpler than the law as it was first fitted
    return replace(
        named,
        parameters=dict(best.parameters),
        fixed={k: v for k, v in best.values.items() if k not in best.parameters},
        statement=form_named(best.family).said(best.text, named.element or named.where),
    )


def _remainder(account: Account[Any], verdict: Verdict) -> Remainder:
    """Return what the recordings hold beyond the model that the answer claims made them.

    Where nothing explains: beyond what explains most, or beyond the linear rig where that leaves nothing and is still
    not named.
    """
    selection, policy = account.selection, account.selection.problem.policy
    model, screening, share = selection.baseline, selection.screening, 0.0 if verdict == "consistent" else 1.0
    refused = verdict == "unexplained" and selection.last_screening.p_value >= policy.level
    if verdict != "consistent" and selection.accepted and not refused:
        model, screening, share = selection.best, selection.last_screening, selection.left.share
    left, p_value = screening.unexplained, 0.0 if account.far_off else screening.p_value
    beyond = p_value < policy.level and verdict != "consistent"
    where = account.left_at(model, screening) if beyond else None
    linear = selection.problem.linear
    said = remainder_statement(linear, share, left, p_value, where, account.beyond_held_out(model))
    return Remainder(share, left, p_value, where, said)


def _upper_limits(account: Account[Any], named: Sequence[Named]) -> tuple[UpperLimit, ...]:
    """Return the limit of every mechanism that was scored against what is left.

    What these data cannot tell from a mechanism that is named has none: it may be there in the other's place.
    """
    if account.far_off:
        return ()  # the description is wrong: nothing is left that a limit could be told from
    present = {m.id for m in named} | {k for m in named for k in m.indistinguishable_from}
    selection = account.selection
    screening = selection.last_screening if named else selection.screening
    left = beyond_noise(selection, screening)
    found = upper_limits([s for s in screening.scores if s.term.mechanism.id not in present], left)
    return tuple(replace(u, unit=account.unit(u.unit)) for u in found)
