"""Rivals of a diagnosis: what else the recordings could hold, how likely that is, and why it is not what is named."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from analysis.mismatch.account import Account, Otherwise, relative
from analysis.mismatch.answer import Rival
from analysis.mismatch.learning import is_learned
from analysis.mismatch.limits import probability_of_nothing, rivals_of_nothing
from analysis.mismatch.ring_downs.candidates import screened_evidence
from analysis.mismatch.selection import Candidate, name_of

RIVALS = 4  # that are reported
LIKELY = 0.01  # probability from which on a rival's held-out error is computed too
BEST_OF_NONE = 2  # candidates whose held-out error is computed where nothing is named: none of them is likely


def rivals_of(account: Account[Any], otherwise: Otherwise[Any] | None) -> tuple[Rival, ...]:
    """Return the runner-up and those behind it, from the first step of the selection.

    ``otherwise``: how the rig would have to be described for nothing to be missing.
    """
    selection = account.selection
    if not selection.steps:
        if account.far_off:
            return ()  # the description is wrong: what would take away most of the residual says nothing
        gains = [(s.term.mechanism.id, screened_evidence(s)) for s in selection.screening.scores]
        return tuple(_fitted(account, rival, otherwise) for rival in rivals_of_nothing(gains, selection.p_value))
    step = selection.steps[0]
    named = step.accepted if selection.chosen is not None else None
    others: dict[str, Candidate[Any]] = {}
    for c in step.candidates:
        if named is None or c.id != named.id:
            others.setdefault(c.id, c)
    certain = 1 if named else BEST_OF_NONE
    first: float | None = None
    found: list[Rival] = []
    for i, c in enumerate(_shown(named, list(others.values()))):
        if i == 0 or c.fit:
            found.append(_rival(account, c, i < certain, first))
            first = None if named else found[0].heldout_rms
    if otherwise is not None:
        found = [replace(r, why=f"{r.why} {_instead(otherwise)}") for r in found]
    return tuple(sorted(found, key=lambda r: -r.probability))


def _shown(named: Candidate[Any] | None, others: list[Candidate[Any]]) -> list[Candidate[Any]]:
    """Return the best of the others; beside a learned law the best listed one among them."""
    shown, listed = others[:RIVALS], [c for c in others if c.fit is not None and not is_learned(c.score.term)]
    if named is not None and listed and all(is_learned(c.score.term) for c in (named, *shown)):
        shown[-1] = listed[0]
    return shown


def _instead(otherwise: Otherwise[Any] | None) -> str:
    if otherwise is None:
        return "The linear rig described otherwise explains as well."
    return f"Nothing beyond noise is left without it once the rig file {otherwise.said}."


def _beside(account: Account[Any], fitted: Any, otherwise: Otherwise[Any] | None) -> float:
    """Return how likely a fit is beside the linear rig described otherwise, which explains no worse.

    A half where it is not known how the rig would have to be described.
    """
    judge = account.selection.judge
    count = sum(len(t.mechanism.parameters) for t in fitted.terms)
    gained = 0.0 if otherwise is None else judge.gained(otherwise.fit, fitted, count)
    weights = relative({"this": min(gained, 0.0), "otherwise": 0.0}, judge.problem.policy.temperature)
    return weights["this"] / sum(weights.values())


def _fitted(account: Account[Any], rival: Rival, otherwise: Otherwise[Any] | None) -> Rival:
    """Return the rival of a linear rig with the error of its full fit on what was held out.

    Nothing is missing in the rig, or it explains as well if it is described otherwise.
    """
    selection = account.selection
    unexplained = selection.p_value < selection.problem.policy.level
    own = [s for s in selection.screening.scores if s.term.mechanism.id == rival.ids[0]]
    place = max(own, key=screened_evidence).term.place
    scores = sorted((s for s in own if s.term.place == place), key=lambda s: -screened_evidence(s))
    selection.judge.on_progress(f"fitting {name_of(scores[0].term.mechanism)}, the runner-up")
    with suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):
        fitted = selection.judge.fitted_alone(selection.baseline, scores)
        error = math.nan if fitted is None else account.held_out_rms(selection.judge.to_the_end(fitted))
        if math.isfinite(error):
            before = account.held_out_rms(selection.baseline)
            beside = f" Fitted in full its error on what was held out is {error:.5g}; the linear rig's is {before:.5g}."
            if unexplained:
                likely = min(rival.probability, _beside(account, fitted, otherwise))
                why = f"{rival.why}{beside} {_instead(otherwise)}"
                return replace(rival, probability=likely, heldout_rms=error, why=why)
            if error < before:
                beside += " What was held out does not choose: the overall test says that nothing is missing."
            return replace(rival, heldout_rms=error, why=rival.why + beside)
    likely = 0.0 if unexplained else rival.probability
    return replace(rival, why=f"{rival.why} Fitted in full it is not admissible.", probability=likely)


def _rival(account: Account[Any], candidate: Candidate[Any], certain: bool, first: float | None) -> Rival:
    """Return what is said of another explanation; its held-out error where it could matter, or ``certain``.

    ``first``: where nothing is named, the held-out error of the best.
    """
    selection, weights = account.selection, account.weights(0)
    step, total = selection.steps[0], weights.total
    if selection.chosen is None or step.accepted is None:
        # nothing is named: each is as likely as that nothing else is at work beside the best of them
        total = max(sum(weights.of.values()), 1.0) / max(probability_of_nothing(selection.left.p_value), 1e-300)
    probability = min(weights.of.get(candidate.id, 0.0) / total, 1.0) if total > 0 else 0.0
    error: float | None = None
    likely = probability > LIKELY or selection.chosen is None
    if candidate.fit is not None and (certain or likely):
        # of one far behind the fit in which it lost is near enough: to its end it may creep for long
        error = account.held_out_rms(selection.judge.to_the_end(candidate.fit) if likely else candidate.fit)
        error = error if math.isfinite(error) else None
    best = step.accepted or step.candidates[0]
    if candidate is best:
        why = "It explains more than any other, but leaves too much over to be named."
        return Rival((candidate.id,), probability, error, why)
    why = account.compared(candidate, best)
    if error is not None and selection.chosen is not None and error < account.held_out_rms(selection.chosen):
        why = f"{why} {account.despite_its_error(candidate, best)}"
    elif error is not None and first is not None and error < first:
        why = f"{why} Its held-out error is smaller all the same: what was held out takes no part in the order."
    return Rival((candidate.id,), probability, error, why)
