"""In which order mechanisms are fitted to ring-downs, and which are worth a fit: from their scores and a first look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import SelectionPolicy
from analysis.mismatch.ring_downs.candidates import screened_evidence
from analysis.mismatch.ring_downs.first_look import FirstLook, Key
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import State
from sim_backend.mechanisms.kinds import ForceLaw


@dataclass(frozen=True, slots=True)
class Order:
    """What there is to fit.

    Attributes
    ----------
    scores
        Of each mechanism in each place, the best first.
    look
        Fits of force laws to the first milliseconds, where the effect is strong.
    hinted
        Terms of other fits, and these: they come first in any case.
    """

    scores: Mapping[Key, list[Score]]
    policy: SelectionPolicy
    look: FirstLook = field(default_factory=FirstLook)
    hinted: Mapping[Key, tuple[Term, RingDownFit]] = field(default_factory=dict)

    def ranked(self) -> list[Score]:
        """Return the best score of each, what is hinted at first, then what is worth it in the first milliseconds."""
        ahead = [*self.hinted, *self.look.worth_fitting()]
        found = each_mechanism_first([scores[0] for scores in self.scores.values()])
        return sorted(found, key=lambda s: ahead.index(s.term.key) if s.term.key in ahead else len(ahead))

    def promising(self, score: Score, gained: float) -> bool:
        """Whether a score earns a full fit where others have gained so much evidence."""
        ranked = [scores[0] for scores in self.scores.values()]
        close = screened_evidence(score) > self.policy.close * max(map(screened_evidence, ranked))
        certain = score.p_value < self.policy.level / len(ranked)
        return certain and (close or screened_evidence(score) > gained)

    def behind(self, key: Key) -> bool:
        """Whether another law is known to explain what this one does not."""
        explaining = self.look.explaining()
        return bool(self.hinted or (explaining and key in self.look.laws)) and key not in [*self.hinted, *explaining]

    def begin(self, key: Key) -> RingDownFit | None:
        """Return the fit of a force law that one of whole segments begins with."""
        hint = self.hinted[key][1] if key in self.hinted else None
        if hint is not None and hint.only_laws and len(hint.terms) == 1:
            return hint
        return self.look.laws.get(key)


def by_mechanism(
    state: State[RingDownFit], hinted: Mapping[Key, object] | None = None, every_law: bool = False
) -> dict[Key, list[Score]]:
    """Return the scores of each mechanism in each place that promises anything or is hinted at, best first."""
    present = {t.key for t in state.current.terms}
    found: dict[Key, list[Score]] = {}
    for score in sorted(state.screening.scores, key=lambda s: -screened_evidence(s)):
        kept = score.term.key in (hinted or {}) or (every_law and isinstance(score.term.mechanism, ForceLaw))
        if score.term.key not in present and (screened_evidence(score) > 0 or kept):
            found.setdefault(score.term.key, []).append(score)
    return found


def each_mechanism_first(scores: Sequence[Score]) -> list[Score]:
    """Return the scores with the best place of every mechanism before its other places, which look much alike."""
    seen: set[str] = set()
    first: list[Score] = []
    others: list[Score] = []
    for score in scores:
        mechanism = score.term.mechanism.id
        (others if mechanism in seen else first).append(score)
        seen.add(mechanism)
    return [*first, *others]
