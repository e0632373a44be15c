"""Statistics of what was not found: upper limits of mechanisms, and the probability that nothing is missing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import norm

from analysis.mismatch.answer import Rival, UpperLimit
from analysis.mismatch.chi_squared import odds_of_nothing
from sim_backend.arrays import Real

if TYPE_CHECKING:
    from analysis.mismatch.score_test import Score

LIMIT_PROBABILITY: Final = 0.95
QUANTILE: Final = float(norm.ppf(LIMIT_PROBABILITY))
PRIOR_ODDS: Final = 0.25  # before the data, that something further is at work over that nothing is


def upper_bound(estimate: float, error: float) -> float:
    """Return the one-sided upper bound of the size of a quantity that is estimated with a normal error.

    An estimate below zero counts as zero, so that a chance fluctuation does not make the bound tighter than the
    measurement can be expected to give (the median bound of Cowan, Cranmer, Gross and Vitells).
    """
    return max(estimate, 0.0) + QUANTILE * error


def amplitude_bound(power: float, information: float, freedom: float) -> float:
    """Return the upper bound of an amplitude that is the same in all segments while its phases are not.

    The sum of squares over variance is a non-central chi-squared, taken as normal with its mean and variance; one
    below its mean without any amplitude counts as that.

    Parameters
    ----------
    power
        Sum of squares of the amplitudes found, each over its variance.
    information
        What the square of an amplitude adds to it: the sum of inverse variances.
    freedom
        Mean of ``power`` without any amplitude: twice the number of segments.

    References
    ----------
    M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions, 26.4.25.
    """
    found, z = max(power - freedom, 0.0), QUANTILE
    return math.sqrt((found + 2 * z**2 + z * math.sqrt(4 * found + 4 * z**2 + 2 * freedom)) / information)


def likelihood_bound(strengths: Real, log_likelihood: Real) -> float:
    """Return the largest strength (n,) whose likelihood ratio does not exclude it; NaN where the last one is not.

    The logarithm of the likelihood (n,) is zero without any strength. Excluded is what lies ``QUANTILE`` ** 2 / 2
    below the best (Wilks). Of two strengths on either side of the bound the larger one is taken.
    """
    least = max(float(log_likelihood.max()), 0.0) - QUANTILE**2 / 2
    first = int(np.max(np.flatnonzero(log_likelihood >= least), initial=-1)) + 1
    return float(strengths[first]) if first < strengths.size else math.nan


def upper_limit(score: Score, left: float = 0.0) -> UpperLimit | None:
    """Return the upper limit of a mechanism's strength from a score.

    Parameters
    ----------
    left
        Chi-squared of what is left over beyond noise. It may be none of the mechanism's or hide as much of it, so that
        the error is wider by its root.

    Returns
    -------
    UpperLimit or None
        In the parameter's unit, infinite beyond its range; None where the mechanism has no strength or its error is not
        known.
    """
    mechanism, values = score.term.mechanism, score.term.values
    if mechanism.strength is not None:
        q = next(q for q in mechanism.parameters if q.name == mechanism.strength)
        name, unit, high, trial = q.name, q.unit, q.high, abs(values[q.name])
    elif mechanism.limited is not None:
        of = mechanism.limited
        name, unit, high, trial = of.name, of.unit, math.inf, of.value(values)
    else:
        return None
    estimate = score.strength if mechanism.one_signed else abs(score.strength)
    bound = trial * upper_bound(estimate, score.error * (1 + math.sqrt(left) / QUANTILE))
    bound = score.bound if math.isnan(bound) else bound
    if math.isnan(bound):
        return None
    return UpperLimit(mechanism.id, name, bound if bound < high else math.inf, unit, LIMIT_PROBABILITY)


def upper_limits(scores: Sequence[Score], left: float = 0.0) -> tuple[UpperLimit, ...]:
    """Return the upper limit of each mechanism, by id: the largest of those of its trials and places.

    So it holds for all values of its other parameters that the trials stand for. Where one of them may be as large as
    its parameter's range, the recordings say nothing and there is no limit.
    """
    largest: dict[tuple[str, str], UpperLimit] = {}
    for score in scores:
        limit = upper_limit(score, left)
        if limit is not None:
            key = (limit.id, limit.parameter)
            largest[key] = max(largest.get(key, limit), limit, key=lambda u: u.value)
    return tuple(largest[k] for k in sorted(largest) if math.isfinite(largest[k].value))


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
        f"Its score test takes away more than any other, a chi-squared of {best[first]:.1f}; by chance alone the "
        f"largest is as large with p = {p_value:.2g}."
    )
    return (Rival((first,), (1 - probability_of_nothing(p_value)) / sum(weights), None, why),)
