"""The budget of a number: each source of its uncertainty with its share (GUM, JCGM 100:2008, Sec. 5 and Annex G)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibration.estimate import LEVEL, Estimate

Distribution = Literal["normal", "t", "rectangular", "two-point"]

BOUNDED_MATTERS = 0.02  # share of the variance from which limits, not a normal law, decide how far an interval reaches
_REACH, _POINTS = 40.0, 8001  # of the grid on which distributions are convolved, in standard uncertainties


@dataclass(frozen=True, slots=True)
class Contribution:
    """One source of uncertainty of a number.

    Attributes
    ----------
    source
        What it is, in words.
    value, unit
        The estimate of the input and its unit; the value is NaN for an input that is a correction of zero.
    standard_uncertainty
        Of the input, in ``unit``.
    sensitivity
        Derivative of the number by the input.
    dof
        Degrees of freedom of ``standard_uncertainty``.
    distribution
        Of the input: ``t`` has ``dof`` degrees of freedom; ``rectangular`` lies within sqrt(3) standard uncertainties;
        ``two-point`` is plus or minus one.
    """

    source: str
    value: float
    unit: str
    standard_uncertainty: float
    sensitivity: float
    dof: float = math.inf
    distribution: Distribution = "normal"

    @property
    def uncertainty(self) -> float:
        """What it adds to the number, a standard uncertainty in the unit of the number."""
        return abs(self.sensitivity) * self.standard_uncertainty


@dataclass(frozen=True, slots=True)
class Budget:
    """All sources of one number, uncorrelated; in ``unit``.

    Examples
    --------
    >>> budget = Budget("load", "mN", 500.0, (Contribution("reading", 21.0, "mV", 0.0126, 23.8),))
    >>> round(budget.standard_uncertainty, 2), round(budget.coverage_factor, 2)
    (0.3, 1.96)
    """

    quantity: str
    unit: str
    value: float
    contributions: tuple[Contribution, ...]

    @property
    def standard_uncertainty(self) -> float:
        """Combined standard uncertainty: root of the sum of the squares (GUM Eq. 10)."""
        return math.sqrt(sum(c.uncertainty**2 for c in self.contributions))

    @property
    def dof(self) -> float:
        """Effective degrees of freedom after Welch and Satterthwaite (GUM Eq. G.2b)."""
        return _effective(self.contributions)

    @property
    def shares(self) -> tuple[float, ...]:
        """Share of each contribution in the variance; they sum to one."""
        total = self.standard_uncertainty**2
        return tuple(c.uncertainty**2 / total if total > 0 else 0.0 for c in self.contributions)

    @property
    def coverage_factor(self) -> float:
        """Half of the 95 % interval over the standard uncertainty.

        Student's t where no error with known limits matters. Elsewhere the distributions are convolved, as a Monte
        Carlo simulation (JCGM 101:2008) would: with u alone, an interval would reach past those limits, or, for an
        error of known size and unknown sign, not as far.
        """
        total = self.standard_uncertainty
        bounded = [c for c in self.contributions if c.distribution in ("rectangular", "two-point")]
        if total == 0.0 or sum(c.uncertainty**2 for c in bounded) < BOUNDED_MATTERS * total**2:
            return _student(self.dof)
        free = [c for c in self.contributions if c.distribution not in ("rectangular", "two-point")]
        spread = math.sqrt(sum(c.uncertainty**2 for c in free)) / total
        half = [math.sqrt(3) * c.uncertainty / total for c in bounded if c.distribution == "rectangular"]
        steps = [c.uncertainty / total for c in bounded if c.distribution == "two-point"]
        return _convolved(spread, _effective(free), half, steps)

    def estimate(self) -> Estimate:
        """Return the number with its standard uncertainty, degrees of freedom and 95 % interval."""
        return Estimate(self.value, self.standard_uncertainty, self.dof, self.coverage_factor)


def _effective(contributions: Sequence[Contribution]) -> float:
    variance = sum(c.uncertainty**2 for c in contributions)
    uncertain = sum(c.uncertainty**4 / c.dof for c in contributions)
    return max(variance**2 / uncertain, 1.0) if uncertain > 0 else math.inf


def _student(dof: float) -> float:
    upper = 0.5 + LEVEL / 2
    return float(special.ndtri(upper) if math.isinf(dof) else special.stdtrit(dof, upper))


def _convolved(spread: float, dof: float, half_widths: Sequence[float], steps: Sequence[float]) -> float:
    """Half of the 95 % interval of a scaled t plus rectangles (+- each half-width) plus steps of either sign."""
    x = np.linspace(-_REACH, _REACH, _POINTS)
    if spread > x[1] - x[0]:
        t = x / spread
        below: NDArray[np.float64] = np.asarray(special.ndtr(t) if math.isinf(dof) else special.stdtr(dof, t))
    else:
        below = np.clip(0.5 + x / (x[1] - x[0]), 0.0, 1.0)
    for width in half_widths:
        if width > x[1] - x[0]:
            below = _smeared(x, below, width)
    for step in steps:
        below = 0.5 * (np.interp(x - step, x, below) + np.interp(x + step, x, below))
    # the distribution is symmetric
    return float(np.interp(0.5 + LEVEL / 2, below, x))


def _smeared(x: NDArray[np.float64], below: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """Cumulative distribution on the grid ``x`` after adding a rectangle of +- ``width``."""
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (below[1:] + below[:-1]) * np.diff(x))])

    def at(y: NDArray[np.float64]) -> NDArray[np.float64]:
        inside = np.interp(y, x, integral)
        return np.asarray(inside + np.maximum(y - x[-1], 0.0), dtype=np.float64)

    return np.asarray((at(x + width) - at(x - width)) / (2 * width), dtype=np.float64)
