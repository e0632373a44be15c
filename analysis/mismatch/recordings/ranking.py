"""Which screened mechanisms are fitted to recordings, from which of their trials, and to how much of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import SelectionPolicy
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate
from sim_backend.learned.forms import FORM
from sim_backend.mechanisms.kinds import AddedBody, ForceLaw, Mechanism

VARIANTS = 3  # of a mechanism in a place, with other values of what is no parameter, that are fitted
TELLS = 6000  # samples of a channel that tell candidates apart; of 20,000 of a chain of four bodies
HOLDS = 0.7  # of what its length would hold of all that the linear rig misses, that a first part holds at least
PARTS = 20  # lengths that are tried
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
