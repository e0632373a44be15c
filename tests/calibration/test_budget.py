"""Budgets: sums, shares, degrees of freedom and coverage."""

import math

import numpy as np
import pytest
from scipy import stats

from calibration.budget import Budget, Contribution


def budget(*contributions):
    return Budget("load", "mN", 500.0, contributions)


def part(u, sensitivity=1.0, dof=math.inf, distribution="normal"):
    return Contribution("", math.nan, "mN", u, sensitivity, dof, distribution)


def test_squares_add_up_and_shares_sum_to_one():
    found = budget(part(0.3), part(0.2, -2.0))
    assert found.standard_uncertainty == pytest.approx(0.5)
    assert found.shares == pytest.approx((0.36, 0.64))


def test_degrees_of_freedom_are_those_of_welch_and_satterthwaite():
    assert budget(part(1.0, dof=7), part(1.0, dof=7)).dof == pytest.approx(14)
    assert budget(part(1.0, dof=7), part(1.0)).dof == pytest.approx(28)


def test_one_source_of_few_degrees_of_freedom_has_students_interval():
    assert budget(part(1.0, dof=4)).coverage_factor == pytest.approx(stats.t.ppf(0.975, 4))


def test_an_error_between_limits_reaches_95_percent_of_them():
    assert budget(part(1.0, distribution="rectangular")).coverage_factor == pytest.approx(0.95 * math.sqrt(3), rel=1e-3)


def test_two_equal_rectangles_make_a_triangle():
    found = budget(part(1.0, distribution="rectangular"), part(1.0, distribution="rectangular"))
    # triangle on +-2 sqrt(3): 95 % within (1 - sqrt(0.05)) of that
    assert found.estimate().half_width == pytest.approx(2 * math.sqrt(3) * (1 - math.sqrt(0.05)), rel=1e-3)


@pytest.mark.parametrize("dof", [math.inf, 6.0])
@pytest.mark.parametrize(("rectangle", "step"), [(1.0, 0.0), (0.4, 1.5), (0.0, 2.0), (2.0, 0.7)])
def test_intervals_are_those_of_a_monte_carlo_simulation(rectangle, step, dof):
    rng = np.random.default_rng(3)
    n = 400_000
    free = rng.standard_normal(n) if math.isinf(dof) else rng.standard_t(dof, n)
    drawn = 0.5 * free + rectangle * math.sqrt(3) * rng.uniform(-1, 1, n) + step * rng.choice([-1, 1], n)
    found = budget(
        part(0.5, dof=dof), part(rectangle, distribution="rectangular"), part(step, distribution="two-point")
    )
    assert found.estimate().half_width == pytest.approx(np.quantile(np.abs(drawn), 0.95), rel=0.01)


def test_nothing_uncertain_has_no_width():
    assert budget().estimate().half_width == 0.0
