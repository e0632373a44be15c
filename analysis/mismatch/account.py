"""What an experiment says of a selection: how likely each candidate is, where the recordings hold more, what next.

Impacts (`impact_account`) and blocks of a recording (`block_account`) each tell it in their own way; `diagnosis` makes
one answer of it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic

from analysis.mismatch.answer import AtAmplitude, FitSummary, FittedRig, Interval, Location, Named, NextExperiment
from analysis.mismatch.intervals import NORMAL_95, intervals
from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import SelectionPolicy
from analysis.mismatch.problem import FitOf
from analysis.mismatch.score_test import Screening
from analysis.mismatch.selection import Candidate, Selection
from sim_backend.arrangement import Arrangement, Element, Parameter
from sim_backend.mechanisms.kinds import AddedBody, ChannelDistortion, ForceLaw, Mechanism, SecondImpact, Tones

UNLISTED = "something else"
OF_AN_ELEMENT = ("tube springs", "contact")  # components of the tester, of which another rig's element takes the place
OF_OTHER_RIGS = {"frame": "frame", "sensor chain": "sensor"}  # classes of what else is no body
FAR_OFF = 3.0  # declared standard errors beyond which a fitted constant is told: one sound constant in 400
MOST_DECIMALS = 6  # of a load in its label, mN


@dataclass(frozen=True, slots=True)
class Weights:
    """How likely the candidates of a step are.

    Attributes
    ----------
    of
        By id, over the likeliest.
    total
        What all of them, what is not listed and nothing at all add up to.
    alike
        Ids that these data cannot tell from the accepted one.
    remark
        What is to be said of it beside the mechanism's own statement.
    """

    of: Mapping[str, float]
    total: float
    alike: tuple[str, ...] = ()
    remark: str = ""

    def probability(self, name: str) -> float:
        """Return how likely a candidate is."""
        return min(self.of.get(name, 0.0) / self.total, 1.0) if self.total > 0 else 0.0


@dataclass(frozen=True, slots=True)
class Otherwise(Generic[FitOf]):
    """The rig described in another way, with which nothing is left: what the description does otherwise, the fit.

    ``element`` is the one that is described otherwise, if one is.
    """

    said: str
    fit: FitOf
    element: Element | None = None


@dataclass(frozen=True, slots=True)
class Account(ABC, Generic[FitOf]):
    """See the module."""

    selection: Selection[FitOf]

    @abstractmethod
    def weights(self, number: int) -> Weights:
        """Return how likely the candidates of the step are that accepted the mechanism of this number."""

    def described_otherwise(self) -> Otherwise[FitOf] | None:
        """Return how the rig would have to be described for nothing to be missing; None where no way is known."""
        return None

    @abstractmethod
    def location(self, named: Sequence[Named], otherwise: Otherwise[FitOf] | None = None) -> Location:
        """Return where the recordings hold more than the linear rig."""

    @abstractmethod
    def left_at(self, model: FitOf, screening: Screening) -> Location:
        """Return where the recordings hold more than a model."""

    @abstractmethod
    def summary(self, chosen: FitOf | None) -> FitSummary:
        """Return how well held-out segments are predicted."""

    @abstractmethod
    def held_out_rms(self, fitted: FitOf) -> float:
        """Return the error on held-out segments; NaN where there are none."""

    @abstractmethod
    def loudest_tone(self, fitted: FitOf) -> tuple[float, float, str]:
        """Return amplitude, standard error and unit of the loudest tone of a fit, as the recordings hold it."""

    def read_off(self, fitted: FitOf, term: Term) -> tuple[float, float, str] | None:
        """Return value, standard error and unit of a strength that is no parameter of the fit; None where it is one."""
        tones = isinstance(term.mechanism, Tones) and term.mechanism.strength is not None
        return self.loudest_tone(fitted) if tones else None

    @abstractmethod
    def compared(self, candidate: Candidate[FitOf], best: Candidate[FitOf]) -> str:
        """Say in a sentence how a rival compares with the best candidate."""

    @abstractmethod
    def despite_its_error(self, candidate: Candidate[FitOf], best: Candidate[FitOf]) -> str:
        """Say why a candidate whose held-out error is smaller is not the one that is named."""

    @abstractmethod
    def next_experiment(self, named: Sequence[Named]) -> NextExperiment | None:
        """Return what would part the best explanations."""

    @abstractmethod
    def fitted(self) -> FittedRig | None:
        """Return the rig as fitted."""

    def beyond_held_out(self, fitted: FitOf) -> str:
        """Say where a model's errors on what was held out are beyond noise; nothing where they are not."""
        return ""

    @property
    def groups(self) -> Mapping[str, float]:
        """Load (N) of each group by its label."""
        return {}

    @property
    def far_off(self) -> bool:
        """Whether the rig as declared misses most of the motion, so that its own constants must be wrong."""
        return False

    @property
    def worse_than_zero(self) -> str:
        """Say that the linear rig predicts worse than zero does, and what to leave free; nothing where it does not."""
        return ""

    @property
    def decay(self) -> tuple[AtAmplitude, ...]:
        """Frequency and damping against amplitude, of a free decay of one body."""
        return ()

    def unit(self, unit: str) -> str:
        """Return a unit of N and m in the rig's own units."""
        return unit

    def parameters(self, fitted: FitOf, number: int) -> tuple[Term, dict[str, Interval]]:
        """Return a term of a fit, and its parameters with their intervals; how loud tones are is read off."""
        term = fitted.terms[number]
        read, name = self.read_off(fitted, term), term.mechanism.strength
        if read is not None and name is not None:
            value, error, unit = read
            known = Interval(value, value - NORMAL_95 * error, value + NORMAL_95 * error, unit)
            return term.moved({name: value}), {name: known}
        selection = self.selection
        left = beyond_noise(selection, selection.last_screening) if selection.problem.noise_known else 0.0
        return term, {k: replace(v, unit=self.unit(v.unit)) for k, v in intervals(fitted, number, left).items()}

    def named(self, fitted: FitOf, number: int) -> Named:
        """Return what is said of a mechanism that was accepted."""
        weights = self.weights(number)
        term, parameters = self.parameters(fitted, number)
        rig, mechanism = self.selection.problem.arrangement, term.mechanism
        name = mechanism.named(rig, term.place)
        same = [m.id for m in self.selection.judge.known if mechanism.id in m.same_as]
        return Named(
            mechanism.id,
            weights.probability(mechanism.id),
            self.component(term),
            mechanism.statement(term.values, name) + weights.remark,
            parameters,
            tuple(dict.fromkeys((*weights.alike, *same))),
            term.fixed,
            name if isinstance(mechanism, ForceLaw) and len(term.place) == 1 else self.element(term, name),
        )

    def element(self, term: Term, name: str) -> str | None:
        """Return the rig's own name of what a term that is not a law of one element acts on."""
        return None

    def component(self, term: Term) -> str:
        """Return the class of the component that a term stands for."""
        m = term.mechanism
        if m.component in self.selection.problem.parts:
            return m.component
        if isinstance(m, ForceLaw):
            return self.selection.problem.arrangement.elements[term.place[0]].component
        if isinstance(m, ChannelDistortion):
            return m.of
        if isinstance(m, SecondImpact):
            return "body" if m.driven else "input"
        if isinstance(m, AddedBody) and m.component in OF_AN_ELEMENT:
            return self.selection.problem.arrangement.elements[term.place[0]].component
        return "sensor" if isinstance(m, Tones) else OF_OTHER_RIGS.get(m.component, "body")


def beyond_noise(selection: Selection[FitOf], screening: Screening) -> float:
    """Return the chi-squared beyond noise of what a model leaves; 0 where it leaves nothing."""
    if screening.p_value >= selection.problem.policy.level:
        return 0.0
    return max(screening.unexplained, *(s.gain - s.dof for s in screening.scores), 0.0)


def element_of_component(rig: Arrangement, component: str) -> str | None:
    """Return the element that is a component of its own; None where several are or none is."""
    own = [e.name for e in rig.elements if e.component == component]
    return own[0] if len(own) == 1 else None


def relative(evidence: Mapping[str, float], temperature: float = 1.0) -> dict[str, float]:
    """Return how likely each is over the likeliest, from twice the logarithms."""
    top = max(evidence.values(), default=0.0)
    return {k: math.exp((v - top) / 2 / temperature) for k, v in evidence.items()}


def odds_of_unlisted(policy: SelectionPolicy, gain: float, mechanism: Mechanism) -> float:
    """Return how likely it is that what is not listed is at work, over that a mechanism that gained so much is.

    The weaker an effect, the more there is that looks like it: of a small chi-squared nearly anything does. Linear
    dynamics of any kind look like those of an added body, however strong.
    """
    weak = policy.unlisted * min(1.0, policy.likeness / max(gain, 1.0))
    looks_like = policy.unlisted if isinstance(mechanism, AddedBody) else 0.0
    return max(policy.strong_likeness + weak, looks_like)


def far_off(fitted: Mapping[str, float], declared: Iterable[Parameter]) -> dict[str, float]:
    """Return by how many declared standard errors fitted constants are off, by name, where that is `FAR_OFF`."""
    found = {}
    for p in declared:
        if p.name in fitted and 0 < p.uncertainty < math.inf:
            off = abs(fitted[p.name] - p.value) / p.uncertainty
            if off > FAR_OFF:
                found[p.name] = off
    return found


def group_labels(loads_n: Sequence[float]) -> dict[str, float]:
    """Return each load (N) by its label in mN, ascending, with as many decimals as tell all of them apart.

    Examples
    --------
    >>> group_labels([0.2504, 0.1042])
    {'104 mN': 0.1042, '250 mN': 0.2504}
    >>> group_labels([0.10401, 0.10419])
    {'104.0 mN': 0.10401, '104.2 mN': 0.10419}
    """
    loads = sorted(set(loads_n))
    for decimals in range(MOST_DECIMALS):
        labels = {f"{1e3 * load:.{decimals}f} mN": load for load in loads}
        if len(labels) == len(loads):
            return labels
    return {f"{1e3 * load!r} mN": load for load in loads}
