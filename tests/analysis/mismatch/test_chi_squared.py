"""What a gain in chi-squared says: its tail far out, the penalty for free numbers, odds of nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import gammaln, logsumexp

from analysis.mismatch.chi_squared import evidence, log_tail, odds_of_nothing


def test_odds_of_nothing_are_the_least_bayes_factor_of_all_beta_alternatives() -> None:
    # under an alternative p is Beta(a, 1): density a p^(a - 1); the null's odds are least for the best a
    for p in (1e-6, 1e-3, 0.05, 0.3):
        a = np.linspace(1e-3, 1.0, 200_001)
        assert odds_of_nothing(p) == pytest.approx(1 / float(np.max(a * p ** (a - 1))), rel=1e-5)
    assert odds_of_nothing(0.0) == 0.0
    assert odds_of_nothing(0.9) == 1.0


@pytest.mark.parametrize(("gain", "dof"), [(3.0, 2), (700.0, 48), (5e3, 2), (5e3, 96), (2e5, 400)])
def test_the_tail_of_chi_squared_is_right_far_out_too(gain: float, dof: int) -> None:
    k = np.arange(dof // 2)  # with an even number of degrees of freedom the tail is a sum of Poisson's probabilities
    exact = logsumexp(k * math.log(gain / 2) - gammaln(k + 1)) - gain / 2
    assert log_tail(gain, dof) == pytest.approx(exact, rel=1e-4, abs=1e-3)


def test_evidence_on_two_degrees_of_freedom_is_the_gain_itself() -> None:
    assert evidence(40.0, 2) == pytest.approx(40.0)
    assert evidence(-3.0, 2) == -3.0


@pytest.mark.parametrize(("gain", "cost"), [(4.0, 2.0), (100.0, math.log(100.0)), (1e4, math.log(1e4))])
def test_a_parameter_costs_the_logarithm_of_the_gain_and_two_at_least(gain: float, cost: float) -> None:
    assert evidence(gain, 0) - evidence(gain, 0, parameters=1) == pytest.approx(cost)
