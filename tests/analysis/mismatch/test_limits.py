"""What was not found: upper limits of mechanisms, and the probability that nothing is missing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from analysis.mismatch.limits import (
    complete_probability,
    probability_of_nothing,
    rivals_of_nothing,
    upper_bound,
    upper_limit,
)
from tests.analysis.terms import listed

FRICTION = listed("guide_friction")
GAIN = listed("channel_gain")


@pytest.mark.parametrize("strength", [0.0, 0.5, 2.0, 8.0])
def test_an_upper_bound_holds_the_strength_at_least_as_often_as_it_says(strength: float) -> None:
    estimates = strength + np.random.default_rng(1).standard_normal(20_000)
    covered = np.mean([upper_bound(float(e), 1.0) >= strength for e in estimates])
    assert covered > 0.95 - 3 * math.sqrt(0.95 * 0.05 / 20_000)


def test_a_negative_estimate_gives_no_tighter_bound_than_zero() -> None:
    assert upper_bound(-3.0, 0.1) == pytest.approx(norm.ppf(0.95) * 0.1)


def test_a_limit_is_in_the_parameters_unit() -> None:
    limit = upper_limit(FRICTION, {"friction_force_n": 1e-6}, 2.0, 0.5)
    assert limit is not None
    assert (limit.parameter, limit.unit, limit.probability) == ("friction_force_n", "N", 0.95)
    assert limit.value == pytest.approx(1e-6 * (2.0 + norm.ppf(0.95) * 0.5))


def test_the_limit_of_what_may_have_either_sign_is_of_its_size() -> None:
    values = {q.name: 1e-4 for q in GAIN.parameters}
    up, down = upper_limit(GAIN, values, 2.0, 0.5), upper_limit(GAIN, values, -2.0, 0.5)
    assert up is not None
    assert up == down


def test_a_limit_stays_in_the_range_of_the_parameter() -> None:
    limit = upper_limit(FRICTION, {"friction_force_n": 1e25}, 2.0, 0.5)
    assert limit is not None
    assert limit.value == next(q.high for q in FRICTION.parameters if q.name == "friction_force_n")


@pytest.mark.parametrize(("name", "error"), [("contact_loss", 0.1), ("guide_friction", math.nan)])
def test_what_has_no_strength_or_no_error_has_no_limit(name: str, error: float) -> None:
    mechanism = listed(name)
    assert upper_limit(mechanism, {q.name: 1.0 for q in mechanism.parameters}, 1.0, error) is None


def test_names_are_less_complete_the_surer_something_is_left() -> None:
    clean, doubtful, left = (complete_probability([0.98], p) for p in (0.5, 0.01, 1e-8))
    assert 0.98 > clean > doubtful > left
    assert left < 1e-4
    assert clean == pytest.approx(0.98 * probability_of_nothing(0.5))


def test_the_rival_of_nothing_is_what_would_gain_most() -> None:
    (rival,) = rivals_of_nothing([("a", 3.0), ("b", 5.0), ("b", 1.0)], 0.4)
    assert rival.ids == ("b",)
    assert rival.probability == pytest.approx((1 - probability_of_nothing(0.4)) / (1 + math.exp(-1)))
