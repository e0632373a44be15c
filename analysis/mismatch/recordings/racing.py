"""Ranked mechanisms fitted one after another, each as long and from as many starts as may matter."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial

from analysis.mismatch.policy import SelectionPolicy
from analysis.mismatch.problem import OnProgress
from analysis.mismatch.recordings.beginning import FOLLOWED
from analysis.mismatch.recordings.blocks import independent_samples
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings
from analysis.mismatch.recordings.ranking import Ranking, with_time
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate, name_of
from sim_backend.mechanisms.kinds import AddedBody, Mechanism

HOPELESS = 4.0  # times the best objective so far, from which a competing fit is given up
EXPLAINED = 1.5  # the same, beside what was named before, where the best leaves noise alone (rig of decision 184)

Joined = Callable[..., SimulatedFit]
"""From a fit, a score and, by name, the objective ``to_beat`` to the fit with the scored mechanism, too."""


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


@dataclass(frozen=True, slots=True)
class Competition:
    """Fits of a problem beside one that stands, against the nearest of them and what was named already, if anything."""

    problem: SimulatedRecordings
    begun: SimulatedFit
    rival: SimulatedFit | None = None

    def run(
        self, ranking: Ranking, nearest: SimulatedFit, joined: Joined, on_progress: OnProgress
    ) -> list[tuple[Score, SimulatedFit]]:
        """Fit what earns a fit."""
        fits: list[tuple[Score, SimulatedFit]] = []
        for scores in ranking.scores[: ranking.finalists]:
            mechanism = scores[0].term.mechanism
            on_progress(f"fitting {name_of(mechanism)}")
            reach = math.inf if self.rival is None else in_reach(self.rival)
            most = math.inf if self._patient(mechanism) else to_beat(nearest, self.begun)
            fitted_from = partial(joined, self.begun, to_beat=min(most, reach))
            further = no_further(nearest, self.begun, mechanism)
            fits.append(from_starts(scores, fitted_from, min(further, reach)))
            nearest = min(nearest, fits[-1][1], key=lambda f: f.objective)
        return fits

    def _patient(self, mechanism: Mechanism) -> bool:
        """Whether a fit is not given up where it comes slowly nearer: a first added body may pass a long valley.

        Nor is one whose full fit is compared in any case (`told_in_any_case`).
        """
        return (isinstance(mechanism, AddedBody) and not self.begun.terms) or told_in_any_case(self.problem, mechanism)


def told_in_any_case(problem: SimulatedRecordings, mechanism: Mechanism) -> bool:
    """Whether a mechanism goes with time where time and amplitude are confounded: its full fit is compared."""
    return problem.one_decay and with_time(mechanism)


def in_reach(of: SimulatedFit) -> float:
    """Return the objective that a fit has to reach for its mechanisms to take the place of another one's."""
    return (EXPLAINED if of.little_predicted else HOPELESS) * of.objective


def to_beat(nearest: SimulatedFit, begun: SimulatedFit) -> float:
    """Return the objective that further fits beside one have to reach, where the nearest of them so far is known."""
    if nearest.terms == begun.terms:
        return math.inf
    return in_reach(nearest) if begun.terms else HOPELESS * nearest.objective


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


def converged(
    fits: Sequence[tuple[Score, SimulatedFit]],
    finer: Collection[int],
    patient: Collection[int],
    polished: Callable[[SimulatedFit, float], SimulatedFit],
) -> list[tuple[Score, SimulatedFit]]:
    """Fit some of ranked candidates, the best first, until they have converged, or are beaten by one that has.

    Parameters
    ----------
    finer
        Which.
    patient
        Which of them are not given up.
    polished
        From a fit and the objective to beat to the converged fit.
    """
    found, beats = list(fits), math.inf
    for i in sorted(finer):
        score, rough = fits[i]
        found[i] = score, polished(rough, math.inf if i in patient else beats)
        beats = min(beats, certainly_worse(found[i][1]))
    return found


def certainly_worse(than: SimulatedFit) -> float:
    """Return the objective from which another fit is less likely than one by more than chance."""
    independent = sum(independent_samples(than, part) for part in (FIT, CHOOSE))
    return weight_of(than) * than.objective * math.exp(than.problem.policy.certain_by_blocks / independent)
