"""Which force laws explain the first milliseconds after the taps.

Where an effect is strong, its score says little of its fit, and a fit to whole segments from the linear rig's constants
skips cycles and is lost. Over a few periods neither happens: what explains these is fitted first, and from there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from analysis.mismatch.ring_downs.continuation import linear_at_first
from analysis.mismatch.ring_downs.fit import Start, Stop, fit
from analysis.mismatch.ring_downs.problem import RingDownFit, RingDowns
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import started
from sim_backend.mechanisms.kinds import ForceLaw

TAPS = 2  # of each load that are looked at
_SOON = Stop(12, gain=5.0, known=False)

Key = tuple[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class FirstLook:
    """Fits of force laws to the first milliseconds.

    Attributes
    ----------
    linear
        The fit of the linear rig to the same.
    laws
        The best fit of each law in each place.
    """

    linear: RingDownFit | None = None
    laws: Mapping[Key, RingDownFit] = field(default_factory=dict)

    def left(self, key: Key) -> float:
        """Return the share of what the linear rig misses that a law leaves; 1 of what was not looked at."""
        if self.linear is None or key not in self.laws:
            return 1.0
        numbers = sum(r.size for r in self.linear.residuals)
        return max(self.laws[key].chi_squared - numbers, 0.0) / max(self.linear.chi_squared - numbers, 1.0)

    def explaining(self) -> list[Key]:
        """Return what leaves no more than one mechanism may, the best first."""
        if self.linear is None:
            return []
        most = self.linear.problem.policy.may_be_left(1)
        return sorted((k for k in self.laws if self.left(k) < most), key=self.left)


def first_look(current: RingDownFit, by_key: Mapping[Key, Sequence[Score]]) -> FirstLook:
    """Fit each force law to the first milliseconds after some taps of each load.

    Parameters
    ----------
    by_key
        Scores of each mechanism in each place, the best first.
    """
    problem = _some_taps(current.problem)
    linear, masses = linear_at_first(problem, current), Start(kept=tuple(problem.arrangement.masses))
    laws: dict[Key, RingDownFit] = {}
    for key, scores in by_key.items():
        if not isinstance(scores[0].term.mechanism, ForceLaw):
            continue
        for score in _of_each_shape(scores):
            with suppress(ValueError, np.linalg.LinAlgError):
                found = fit(linear.problem, [started(score)], linear, masses, _SOON)
                if found.objective < (laws[key].objective if key in laws else math.inf):
                    laws[key] = found
    return FirstLook(linear, laws)


def _some_taps(problem: RingDowns) -> RingDowns:
    """Return a problem with the first taps of each load, or group of constants."""
    kept: list[int] = []
    seen: dict[int, int] = {}
    for i, segment in enumerate(problem.experiment.segments):
        seen[segment.group] = seen.get(segment.group, 0) + 1
        if seen[segment.group] <= TAPS:
            kept.append(i)
    return problem.only(kept)


def _of_each_shape(scores: Sequence[Score]) -> list[Score]:
    """Return the best score with each set of fixed values."""
    best: dict[frozenset[tuple[str, float]], Score] = {}
    for score in scores:
        best.setdefault(frozenset(score.term.fixed.items()), score)
    return list(best.values())
