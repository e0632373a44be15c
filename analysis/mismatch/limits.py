"""Statistics of what was not found: upper limits of mechanisms, and the probability that nothing is missing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from scipy.stats import norm

from analysis.mismatch.answer import Rival, UpperLimit
from analysis.mismatch.chi_squared import odds_of_nothing
from sim_backend.mechanisms.kinds import Mechanism, Values

LIMIT_PROBABILITY: Final = 0.95
PRIOR_ODDS: Final = 0.25  # before the data, that something further is at work over that nothing is


def upper_bound(estimate: float, error: float, probability: float = LIMIT_PROBABILITY) -> float:
    """Return the one-sided upper bound of the size of a quantity that is estimated with a normal error.

    An estimate below zero counts as zero, so that a chance fluctuation does not make the bound tighter than the
    measurement can be expected to give (the median bound of Cowan, Cranmer, Gross and Vitells).
    """
    return max(estimate, 0.0) + float(norm.ppf(probability)) * error


def upper_limit(mechanism: Mechanism, values: Values, strength: float, error: float) -> UpperLimit | None:
    """Return the upper limit of a mechanism's strength from its score test.

    Parameters
    ----------
    values
        Of the trial that was scored.
    strength, error
        Estimate of the strength over the trial's, and its standard error.

    Returns
    -------
    UpperLimit or None
        In the unit of the parameter and within its range; None where the mechanism has no strength or its error is
        not known.
    """
    if mechanism.strength is None or not math.isfinite(error):
        return None
    q = next(q for q in mechanism.parameters if q.name == mechanism.strength)
    estimate = strength if mechanism.one_signed else abs(strength)
    bound = abs(values[q.name]) * upper_bound(estimate, error)
    return UpperLimit(mechanism.id, q.name, min(max(bound, q.low), q.high), q.unit, LIMIT_PROBABILITY)


def probability_of_nothing(p_value: float) -> float:
    """Return the probability that nothing further is missing after a test with this p-value, by the same bound."""
    odds = odds_of_nothing(p_value) / PRIOR_ODDS
    return odds / (1 + odds)


def complete_probability(names: Sequence[float], p_value: float) -> float:
    """Return the probability that all names are right and nothing else is at work.

    Parameters
    ----------
    names
        Probability of each mechanism that is named.
    p_value
        Of what they leave over.
    """
    return math.prod(names) * probability_of_nothing(p_value)


def rivals_of_nothing(gains: Sequence[tuple[str, float]], p_value: float) -> tuple[Rival, ...]:
    """Return the mechanism that would explain most of what the linear rig leaves, where that is no more than noise.

    Parameters
    ----------
    gains
        Mechanisms and the chi-squared, on two degrees of freedom, that each would take away; one may be there several
        times.
    p_value
        Under the linear rig.
    """
    best: dict[str, float] = {}
    for name, gain in gains:
        best[name] = max(best.get(name, 0.0), gain)
    if not best:
        return ()
    first = max(best, key=lambda k: best[k])
    weights = [math.exp((v - best[first]) / 2) for v in best.values()]
    why = (
        f"Of all mechanisms it would take away most of the residual, a chi-squared of {best[first]:.1f}; by chance "
        f"alone the largest is as large with p = {p_value:.2g}."
    )
    return (Rival((first,), (1 - probability_of_nothing(p_value)) / sum(weights), None, why),)
