"""Which force laws explain the first milliseconds after the taps.

Where an effect is strong, its score says little of its fit, and a fit to whole segments from the linear rig's constants
skips cycles and is lost. Over a few periods neither happens: what explains these is fitted first, and from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs.continuation import declared_constants, each_alone, linear_at_first
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

    def worth_fitting(self) -> list[Key]:
        """Return what takes up much of what the linear rig misses, the best first; then what was lost even here."""
        if self.linear is None:
            return []
        most = 1 - self.linear.problem.policy.serious
        better = sorted((k for k in self.laws if self.left(k) < most), key=self.left)
        return [*better, *(k for k in self.laws if self.left(k) > 1)]


def first_look(current: RingDownFit, by_key: Mapping[Key, Sequence[Score]]) -> FirstLook:
    """Fit each force law to the first milliseconds after the strongest taps of each load.

    Parameters
    ----------
    by_key
        Scores of each mechanism in each place, the best first.

    Returns
    -------
    FirstLook
        Nothing where the linear rig explains these, too: what shows later is found by its score.
    """
    linear = linear_at_first(_strongest_taps(current), current)
    if linear.reduced_chi_squared < linear.problem.policy.strong:
        return FirstLook()
    laws: dict[Key, RingDownFit] = {}
    for key, scores in by_key.items():
        if isinstance(scores[0].term.mechanism, ForceLaw):
            fits = [f for s in _of_each_shape(scores) for f in _soon(linear, started(s))]
            if fits:
                laws[key] = min(fits, key=lambda one: one.objective)
    return FirstLook(linear, laws)


def _soon(linear: RingDownFit, term: Term) -> list[RingDownFit]:
    """Return the fits of a law: from the linear rig's, and where that is lost, from the declared rig."""
    masses, problem = Start(kept=linear.arrangement.force_scales), linear.problem
    fits: list[RingDownFit] = []
    with suppress(ValueError, np.linalg.LinAlgError):
        fits.append(fit(problem, [term], linear, masses, _SOON))
    if not fits or fits[0].objective > linear.objective:
        with suppress(ValueError, np.linalg.LinAlgError):
            declared = declared_constants(problem, linear)
            start = replace(masses, amplitudes=each_alone(problem, [term], declared))
            fits.append(fit(problem, [term], declared, start, _SOON))
    return fits


def _strongest_taps(current: RingDownFit) -> RingDowns:
    """Return a problem with the strongest taps of each load, or group of constants."""
    problem, strength = current.problem, [float(np.abs(s.raw).max()) for s in current.segments]
    kept: list[int] = []
    for group in sorted({s.group for s in problem.experiment.segments}):
        own = [i for i, s in enumerate(problem.experiment.segments) if s.group == group]
        kept += sorted(own, key=lambda i: -strength[i])[:TAPS]
    return problem.only(sorted(kept))


def _of_each_shape(scores: Sequence[Score]) -> list[Score]:
    """Return the best score with each set of fixed values."""
    best: dict[frozenset[tuple[str, float]], Score] = {}
    for score in scores:
        best.setdefault(frozenset(score.term.fixed.items()), score)
    return list(best.values())
