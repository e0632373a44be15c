"""What is fitted: free parameters with their scales, bounds and priors, and mechanisms with values and a place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from sim_backend.acting import Acting
from sim_backend.learned.forms import FORM
from sim_backend.mechanisms.kinds import AddedBody, ChannelDistortion, ForceLaw, Quantity, SecondImpact, Tones
from sim_backend.mechanisms.places import Place

UNBOUNDED = 1e20  # width of a range that bounds nothing
ROUNDING_DECADES = 0.5  # by which the speed within which a force jumps may well differ from a trial's
MOST_EXPONENT = 300.0  # of a logarithm: beyond, numbers overflow


@dataclass(frozen=True, slots=True)
class FreeParameter:
    """A number that is fitted as ``x``: its value is ``scale * exp(x)`` or ``scale * x``.

    Attributes
    ----------
    prior
        Declared value and standard error in ``x``; None where nothing is known.
    scope
        What has a value of its own: the rig, each group (load), each segment, or a mechanism.
    owner
        Number of the mechanism among the terms of a fit, or of the segment.
    """

    name: str
    unit: str
    scale: float = 1.0
    log: bool = False
    low: float = -math.inf
    high: float = math.inf
    prior: tuple[float, float] | None = None
    scope: Literal["rig", "group", "segment", "mechanism"] = "rig"
    owner: int = 0

    @classmethod
    def of(cls, quantity: Quantity, owner: int, value: float) -> FreeParameter:
        """Return the parameter of a mechanism; what is no logarithm is scaled by its value, or by its range if zero."""
        q = quantity
        scale = 1.0 if q.log else abs(value) or cls(q.name, q.unit, low=q.low, high=q.high).span
        return cls(q.name, q.unit, scale, q.log, q.low, q.high, scope="mechanism", owner=owner)

    @property
    def span(self) -> float:
        """Width of the range in units of the scale; one where it is as good as unbounded."""
        width = self.high - self.low
        return width / self.scale if width < UNBOUNDED else 1.0

    def outward(self, x: float) -> float:
        """Return the value, within its bounds."""
        value = self.scale * math.exp(min(x, MOST_EXPONENT)) if self.log else self.scale * x
        return min(max(value, self.low), self.high)

    def inward(self, value: float) -> float:
        """Return the number that is fitted."""
        return math.log(max(value / self.scale, 1e-300)) if self.log else value / self.scale

    @property
    def bounds(self) -> tuple[float, float]:
        """Range of ``x``."""
        if self.log:
            low = math.log(self.low / self.scale) if self.low > 0 else -math.inf
            return low, math.log(self.high / self.scale) if math.isfinite(self.high) else math.inf
        low, high = sorted((self.low / self.scale, self.high / self.scale))
        return low, high


@dataclass(frozen=True, slots=True)
class Term(Acting):
    """A mechanism of a fit; ``freed`` lets an added body ring in every segment as it will, not only as the rig does."""

    freed: bool = False

    @property
    def key(self) -> tuple[str, Place]:
        """What makes two terms the same: mechanism and place; of a learned law its family too."""
        family = self.values.get(FORM)
        return self.mechanism.id if family is None else f"{self.mechanism.id}:{family:g}", self.place

    @property
    def nonlinear(self) -> bool:
        """Whether the rig with it is no longer linear, or a channel no longer shows it as it is."""
        return isinstance(self.mechanism, ForceLaw | ChannelDistortion | SecondImpact)

    @property
    def phase_locked(self) -> bool:
        """Whether it adds a body whose ringing is that of the rig's modes, unless `freed` of it."""
        return isinstance(self.mechanism, AddedBody) and self.mechanism.phase_locked and not self.freed

    @property
    def fixed(self) -> dict[str, float]:
        """Values that are no parameters."""
        fitted = {q.name for q in self.mechanism.parameters}
        return {k: float(v) for k, v in self.values.items() if k not in fitted}

    def moved(self, values: Mapping[str, float]) -> Term:
        """Return the same mechanism with other values."""
        return replace(self, values={**self.values, **values})

    def within(self, values: Mapping[str, float]) -> Term:
        """Return it with other values, as near to them as is admissible."""
        ranges = {q.name: (q.low, q.high) for q in self.mechanism.parameters}
        kept = {k: min(max(v, ranges[k][0]), ranges[k][1]) if k in ranges else v for k, v in values.items()}
        return self.moved(kept)


def rounding_of(term: Term, owner: int) -> list[FreeParameter]:
    """Return the speed within which a force that jumps does so; none of another, nor where it jumps at once."""
    name = term.mechanism.rounding if isinstance(term.mechanism, ForceLaw) else ""
    if name not in term.values:
        return []
    prior = (0.0, ROUNDING_DECADES * math.log(10.0))
    return [FreeParameter(name, "m/s", term.values[name], True, prior=prior, scope="mechanism", owner=owner)]


def lines_of(terms: Sequence[Term]) -> list[float]:
    """Return the frequencies, Hz, of all steady tones among terms."""
    return [hz for t in terms if isinstance(t.mechanism, Tones) for hz in t.mechanism.lines(t.values)]


def with_values(terms: Sequence[Term], parameters: Sequence[FreeParameter], x: Iterable[float]) -> tuple[Term, ...]:
    """Return terms with the values that the numbers (k,) of a fit mean; parameters of other scopes are left out."""
    values: list[dict[str, float]] = [{} for _ in terms]
    for p, own in zip(parameters, x, strict=True):
        if p.scope == "mechanism":
            values[p.owner][p.name] = p.outward(float(own))
    return tuple(t.moved(v) for t, v in zip(terms, values, strict=True))
