"""Which screened mechanisms are fitted to recordings, from which of their trials, and to how much of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import SelectionPolicy
from analysis.mismatch.recordings.fit import FOLLOWED, SimulatedFit
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate
from sim_backend.learned.forms import FORM
from sim_backend.mechanisms.kinds import AddedBody, ForceLaw, Mechanism

VARIANTS = 3  # of a mechanism in a place, with other values of what is no parameter, that are fitted
TELLS = 6000  # samples of a channel that tell candidates apart; of 20,000 of a chain of four bodies
HOLDS = 0.7  # of what its length would hold of all that the linear rig misses, that a first part holds at least
PARTS = 20  # lengths that are tried
HOPELESS = 4.0  # times the best objective so far, from which a competing fit is given up
EXPLAINED = 1.5  # the same, beside what was named before, where the best leaves noise alone (rig of decision 184)
APART = 0.2  # of the logarithms of resonances of an added body that are fitted both
BENT_APART = 0.5  # of the logarithms of a law's parameters beside its strength, the same


def with_time(mechanism: Mechanism) -> bool:
    """Whether a mechanism makes the rig change with time, not with amplitude."""
    return isinstance(mechanism, ForceLaw) and mechanism.with_time


def share_that_tells(linear: SimulatedFit) -> float:
    """Return the share of long recordings with inputs, from their beginning, to which candidates are fitted at first.

    It holds as much of what the linear rig misses as is to be expected of its length: a sweep may come to a resonance
    late. Free decays are looked at as a whole.
    """
    problem = linear.problem
    if any(r.free for r in problem.recordings) or problem.samples <= TELLS:
        return 1.0
    missed = [np.cumsum(np.sum(linear.off(i)[0] ** 2, axis=0)) for i in range(len(problem.recordings))]
    total = sum(float(grown[-1]) for grown in missed)
    for share in np.linspace(TELLS / problem.samples, 1.0, PARTS).tolist():
        held = sum(float(grown[math.ceil(share * grown.size) - 1]) for grown in missed)
        if held >= HOLDS * share * total:
            return share
    return 1.0


@dataclass(frozen=True, slots=True)
class Ranking:
    """Scores of each mechanism in each place, the best first, ``finalists`` of which earn a fit."""

    scores: tuple[tuple[Score, ...], ...]
    finalists: int

    @classmethod
    def of(cls, scores: Sequence[Score], policy: SelectionPolicy, promising: float) -> Ranking:
        """Rank scores, which come best first; those with less than a ``promising`` share of the best earn no fit."""
        alike: dict[tuple[str, tuple[int, ...]], list[Score]] = {}
        for score in scores:
            kept = alike.setdefault(score.term.key, [])
            if len(kept) < VARIANTS and all(_another_start(score, other, policy.other_start) for other in kept):
                kept.append(score)
        ranked = tuple(map(tuple, alike.values()))
        finalists = sum(s[0].gain >= promising * ranked[0][0].gain for s in ranked[: policy.finalists_by_blocks])
        return cls(ranked, max(finalists, policy.polished))

    def of_at_least(self, gain: float) -> Ranking:
        """Return the ranking in which only scores of such a gain earn a fit: where a fit gains what its score says."""
        return replace(self, finalists=sum(s[0].gain >= gain for s in self.scores[: self.finalists]))

    def and_then(self, other: Ranking, most: int) -> Ranking:
        """Return two rankings as one, in turn from each; what earns a fit in either does, up to so many."""
        a, b = self.scores, other.scores
        pairs = zip_longest(a[: self.finalists], b[: other.finalists])
        in_turn = [scores for pair in pairs for scores in pair if scores is not None]
        found: dict[tuple[str, tuple[int, ...]], tuple[Score, ...]] = {}
        for scores in (*in_turn, *a[self.finalists :], *b[other.finalists :]):
            found.setdefault(scores[0].term.key, scores)
        return Ranking(tuple(found.values()), min(len({scores[0].term.key for scores in in_turn}), most))


def weight_of(fitted: SimulatedFit) -> float:
    """Return what a fit's error counts for: more where it takes a parameter at the end of what is admissible."""
    return fitted.problem.policy.in_time if fitted.pinned() else 1.0


def from_starts(
    scores: Sequence[Score], fitted_from: Callable[[Score], SimulatedFit], hopeless: float
) -> tuple[Score, SimulatedFit]:
    """Fit a mechanism from its starts and return the best fit, with where it began.

    An added body is fitted from all of them. Another mechanism begins anew where what is no parameter has another
    value, or where all its fits ended at a bound.

    Parameters
    ----------
    hopeless
        Objective of the first fit beyond which there is no other.
    """
    found: list[tuple[Score, SimulatedFit]] = []
    for score in scores:
        if found and found[0][1].objective > hopeless:
            break
        alike = [f for s, f in found if s.term.fixed == score.term.fixed]
        if isinstance(score.term.mechanism, AddedBody) or all(f.pinned() for f in alike):
            found.append((score, fitted_from(score)))
    return min(found, key=lambda pair: weight_of(pair[1]) * pair[1].scatter)


def to_beat(nearest: SimulatedFit, begun: SimulatedFit) -> float:
    """Return the objective that further fits beside one have to reach, where the nearest of them so far is known."""
    if nearest.terms == begun.terms:
        return math.inf
    return (EXPLAINED if begun.terms and nearest.little_predicted else HOPELESS) * nearest.objective


def no_further(nearest: SimulatedFit, begun: SimulatedFit, mechanism: Mechanism) -> float:
    """Return the objective of a mechanism's first fit beyond which it is fitted from no other start.

    Where all is explained, that is out of reach of what explains it. Where much is missed, what explains next to
    nothing of it; not of an added body, whose resonance may be another one.
    """
    if nearest.as_noise:
        return to_beat(nearest, begun)
    compared = not begun.as_noise and begun.problem.looked_at >= 1.0 and not isinstance(mechanism, AddedBody)
    return FOLLOWED * begun.objective if compared else math.inf


def within_reach(candidates: Sequence[Candidate[SimulatedFit]], policy: SelectionPolicy) -> list[int]:
    """Return which of fitted candidates, the best first, are fitted until they have converged: the best few in reach.

    Out of reach is what leaves many times as much as another one, and what has but a share of the evidence of one that
    leaves no more than noise.
    """
    fits = [(c.evidence, c.fit) for c in candidates if c.fit is not None]
    if not fits:
        return []
    most = HOPELESS * min(fitted.scatter for _, fitted in fits)
    evidence, best = fits[0]
    least = policy.hopeful * max(evidence, 0.0) if best.as_noise else -math.inf
    few = enumerate(fits[: policy.polished])
    return [i for i, (told, fitted) in few if fitted.scatter < most and (i == 0 or told >= least)]


def simplest(candidates: Sequence[Candidate[SimulatedFit]], share: float) -> Candidate[SimulatedFit]:
    """Return the best candidate; of learned laws the one with the fewest parameters that explains nearly as much.

    No formula is quite the law of a real rig, so that one with more parameters always explains a little more.
    """
    best = candidates[0]
    if not _learned(best):
        return best
    alike = [c for c in candidates if (_learned(c) and lead_of(best, c, share) <= 0) or c is best]
    return min(alike, key=lambda c: (len(c.mechanism.parameters), -c.evidence))


def lead_of(one: Candidate[SimulatedFit], other: Candidate[SimulatedFit], share: float) -> float:
    """Return the evidence of one candidate over another, less what more parameters of a learned law always explain."""
    more = len(one.mechanism.parameters) > len(other.mechanism.parameters)
    always = share * one.evidence if more and _learned(one) and _learned(other) else 0.0
    return one.evidence - other.evidence - max(always, 0.0)


def _learned(candidate: Candidate[SimulatedFit]) -> bool:
    return candidate.fit is not None and FORM in candidate.fit.terms[-1].values


def _another_start(score: Score, better: Score, share: float) -> bool:
    """Whether what is no parameter has another value, or a share of the gain is left where parameters are others.

    Of an added body its frequency counts, of a law all but its strength.
    """
    one, other = score.term, better.term
    if one.fixed != other.fixed:
        return True
    if score.gain < share * better.gain:
        return False
    body = one.mechanism.body if isinstance(one.mechanism, AddedBody) else None
    if body is None:
        return isinstance(one.mechanism, ForceLaw) and _bent_otherwise(one, other)
    # where the mass is no parameter, it is the same
    apart = [math.log(t.values[body[1]] / t.values.get(body[0], 1.0)) / 2 for t in (one, other)]
    return abs(apart[0] - apart[1]) > APART


def _bent_otherwise(one: Term, other: Term) -> bool:
    """Whether parameters on a scale of logarithms, beside the strength, are others."""
    bent = [q.name for q in one.mechanism.parameters if q.log and q.name != one.mechanism.strength]
    return any(abs(math.log(one.values[name] / other.values[name])) > BENT_APART for name in bent)
