"""What every engine part asks of an experiment: recorded segments, the rig compared with them, and how they are fitted.

A free decay (`ring_down`) and a recording that is simulated from end to end (`simulated`) are the two kinds there are.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import SelectionPolicy
from sim_backend.arrangement import LOAD, Arrangement
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import placed
from sim_backend.mechanisms.kinds import ForceLaw, Mechanism, Scale, SecondImpact

if TYPE_CHECKING:
    from analysis.mismatch.score_test import Score

OnProgress = Callable[[str], None]


def silent(stage: str) -> None:
    """Report no progress."""


@dataclass(slots=True)
class ComputeBudget:
    """Work done, in samples through which an extra force was carried; it is the same whatever the machine."""

    spent: float = 0.0


@dataclass(frozen=True, slots=True)
class Constants:
    """Values of a rig's constants: ``rig`` those with one value, ``load`` (groups, k) those with one at each load."""

    arrangement: Arrangement
    rig: Real
    load: Real

    def names(self) -> tuple[list[str], list[str]]:
        """Names of the constants in ``rig`` and in a row of ``load``."""
        p = self.arrangement.parameters
        return [q.name for q in p if q.scope != LOAD], [q.name for q in p if q.scope == LOAD]

    def at(self, group: int) -> dict[str, float]:
        """All constants at one load."""
        rig, load = self.names()
        return dict(zip(rig, self.rig.tolist(), strict=True)) | dict(zip(load, self.load[group].tolist(), strict=True))

    def stacked(self) -> dict[str, Real]:
        """All constants, (groups,) of each."""
        rig, load = self.names()
        own = np.broadcast_to(self.rig[:, None], (self.rig.size, len(self.load)))
        return dict(zip(rig, own, strict=True)) | dict(zip(load, self.load.T, strict=True))


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    terms
        Mechanisms with their fitted values.
    arrangement
        Of the rig with the bodies and elements that they add.
    residuals
        Of each segment (c, n), whitened (of a simulated recording: over the channels' rms).
    chi_squared
        Sum of squares of the residuals; ``penalty`` is what the declared constants add to it.
    covariances
        Makes `covariance` and `term_covariances`: of most fits that compete nobody asks for them.
    """

    terms: tuple[Term, ...]
    arrangement: Arrangement
    constants: Constants
    residuals: tuple[Real, ...]
    chi_squared: float
    penalty: float
    covariances: Callable[[], tuple[Real, tuple[Real, ...]]]

    @property
    def covariance(self) -> Real:
        """Of the constants with one value, those of each load, and the terms' parameters, in this order.

        Zero where a fit was not made for it.
        """
        return self.covariances()[0]

    @property
    def term_covariances(self) -> tuple[Real, ...]:
        """For each term: covariance (k, k) of its parameters (of the logarithm where one is fitted as such)."""
        return self.covariances()[1]

    @property
    def objective(self) -> float:
        """What was minimised."""
        return self.chi_squared + self.penalty

    @property
    def reduced_chi_squared(self) -> float:
        """Sum of squares of a sample: 1 where nothing but noise is left."""
        return self.chi_squared / sum(r.size for r in self.residuals)

    @property
    def nonlinear(self) -> bool:
        """Whether the rig with the terms is no longer linear, or a channel no longer shows it as it is."""
        return any(t.nonlinear for t in self.terms)


@dataclass(frozen=True, slots=True)
class Rung:
    """What candidates with as many waves of free amplitude each would ring in a segment, by its products.

    Attributes
    ----------
    numbers
        (t,) places of the candidates.
    seen
        (t, w + 1, m) products with the columns that were given, of the waves and of the effect on the rest.
    gram
        (t, w + 1, w + 1) products with each other.
    """

    numbers: NDArray[np.intp]
    seen: Real
    gram: Real

    @classmethod
    def of_each(cls, numbers: NDArray[np.intp], waves: Real, rest: Real, columns: Real) -> Rung:
        """Return it for candidates whose waves (t, w, N) and effects on the rest (t, N) are at hand."""
        x = np.concatenate([waves, rest[:, None]], axis=1)
        return cls(numbers, x @ columns, x @ x.swapaxes(1, 2))


@dataclass(frozen=True, slots=True)
class Columns:
    """What a segment's whitened residual is compared with.

    Attributes
    ----------
    where, slopes
        (k,) places of the constants that act on it among all of them, and (N, k) what a unit of each does.
    made
        (N, t) what each tried term does.
    residual
        (N,).
    own
        (N, m) orthonormal basis of the nuisance parameters of the segment: its initial state, its offsets.
    ringing
        Of the candidate terms that add a free vibration of their own: the products with columns (N, m).
    noise
        (N, draws) draws of what noise makes, where it is not white along the segment for all the whitening; else None.
    """

    where: NDArray[np.intp]
    slopes: Real
    made: Real
    residual: Real
    own: Real
    ringing: Callable[[Real], Iterable[Rung]]
    noise: Real | None = None


FitOf = TypeVar("FitOf", bound=Fit)


class Problem(ABC, Generic[FitOf]):
    """Recorded segments and the rig that should have made them.

    Attributes
    ----------
    noise_known
        Whether the residual's variance is known to be one, so that gains are chi-squared; otherwise it is estimated.
    """

    arrangement: Arrangement
    policy: SelectionPolicy
    budget: ComputeBudget
    noise_known: bool

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the rig."""

    @property
    @abstractmethod
    def parts(self) -> Sequence[str]:
        """Components of the contract that the rig has beside those of its elements."""

    @property
    def linear(self) -> str:
        """What the linear rig is called in sentences."""
        return "the rig as described"

    @property
    @abstractmethod
    def samples(self) -> int:
        """Samples of a channel that are fitted, all segments together."""

    @abstractmethod
    def scale_of(self, fitted: FitOf, place: int) -> Scale:
        """Return how far an element moves."""

    @abstractmethod
    def reach_of(self, fitted: FitOf, place: int) -> tuple[float, float]:
        """Return the largest deformation (m) and rate (m/s) of an element."""

    @abstractmethod
    def columns(self, fitted: FitOf, terms: Sequence[Term], ringing: Sequence[Term]) -> Iterable[Iterable[Columns]]:
        """Return the columns of all segments, in parts that may be summed side by side."""

    @abstractmethod
    def precision(self, fitted: FitOf) -> Real:
        """Return (k,) the inverse variances of the constants that `columns` places, in units of the residual's."""

    def draws(self, fitted: FitOf) -> int:
        """Return how many draws of noise come with `columns`: none where whitening makes it white."""
        return 0

    def second_impact(self, fitted: FitOf, mechanism: SecondImpact) -> Score:
        """Return the score of a second impact; only asked for where `allows` lets it."""
        raise NotImplementedError

    def unmodelled(self, fitted: FitOf) -> tuple[list[float], float]:
        """Return p-values that the residual is noise, by tests that know no mechanism, and the excess they see.

        None where the noise is not known: then a residual's power says nothing.
        """
        return [], 0.0

    def allows(self, mechanism: Mechanism) -> bool:
        """Whether the recordings can show a mechanism at all."""
        return not mechanism.hidden

    def trials(self, fitted: FitOf, known: Iterable[Mechanism]) -> list[Term]:
        """Return every mechanism in every place with every set of values worth screening."""
        found: list[Term] = []
        scales: dict[int, Scale] = {}
        present = {t.key for t in fitted.terms}
        for mechanism, place in placed([m for m in known if self.allows(m)], self.arrangement):
            at = place[0] if isinstance(mechanism, ForceLaw) else 0
            if at not in scales:
                scales[at] = self.scale_of(fitted, at)
            if isinstance(mechanism, ForceLaw) and mechanism.preloaded and not scales[at].static > 0:
                continue  # a fit has left nothing that a preload could rest on
            tried = [Term(mechanism, values, place) for values in mechanism.trials(scales[at])]
            found += [term for term in tried if term.key not in present]
        return found

    def exhausted(self) -> bool:
        """Whether the compute budget of a selection of these recordings is spent."""
        return self.budget.spent > self.policy.budget * max(self.samples, self.policy.usual_samples)
