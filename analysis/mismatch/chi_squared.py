"""What a gain in chi-squared says: the penalty for free numbers, tails far out, odds of nothing."""

from __future__ import annotations

import math

from scipy.special import gammaln
from scipy.stats import chi2

ASYMPTOTIC = 300  # half a chi-squared beyond half its degrees of freedom from which on its tail is a series


def evidence(gain: float, own: int, parameters: int = 0, least_cost: float = 2.0) -> float:
    """Return the chi-squared on two degrees of freedom that is as unlikely by chance as this gain.

    Parameters
    ----------
    own
        Numbers that are free in every segment, all segments together.
    parameters
        Further free numbers: each costs the logarithm of the gain, by which the data have narrowed it down, and
        ``least_cost`` at least.

    Examples
    --------
    >>> evidence(100.0, 0)
    100.0
    >>> round(evidence(100.0, 0, parameters=2), 1)
    90.8
    """
    cost = parameters * max(least_cost, math.log(max(gain, 1.0)))
    return (gain if gain <= 0 else -2 * log_tail(gain, max(own, 2))) - cost


def log_tail(gain: float, dof: int) -> float:
    """Return the logarithm of the tail of chi-squared, far out too."""
    a, x = dof / 2, gain / 2
    if x < a + ASYMPTOTIC:
        return float(chi2.logsf(gain, dof))
    return float(-x + a * math.log(x) - math.log(x + 1 - a) - gammaln(a))


def odds_of_nothing(p_value: float) -> float:
    """Return at least how likely it is that nothing is missing, over that something is, after a test gave this p-value.

    The bound of Sellke, Bayarri and Berger (The American Statistician 55 (2001) 62), both being as likely before.

    Examples
    --------
    >>> round(odds_of_nothing(0.01), 3)
    0.125
    """
    return -math.e * p_value * math.log(p_value) if 0 < p_value < 1 / math.e else float(p_value > 0)


def p_of(smallest: float, tests: float) -> float:
    """Return the p-value of the smallest of so many independent p-values."""
    return float(-math.expm1(tests * math.log1p(-min(smallest, 1 - 1e-12))))
