"""What was not found: upper limits of mechanisms, and the probability that nothing is missing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from analysis.mismatch.limits import (
    amplitude_bound,
    complete_probability,
    likelihood_bound,
    probability_of_nothing,
    rivals_of_nothing,
    upper_bound,
    upper_limit,
    upper_limits,
)
from analysis.mismatch.parameters import Term
from analysis.mismatch.score_test import Score
from sim_backend.mechanisms.kinds import Mechanism, Values
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


def scored(mechanism: Mechanism, values: Values, strength: float, error: float, bound: float = math.nan) -> Score:
    return Score(Term(mechanism, values), 0.0, 1, strength, 0.5, error, bound=bound)


def limit_of(mechanism: Mechanism, values: Values, strength: float, error: float, left: float = 0.0) -> float:
    limit = upper_limit(scored(mechanism, values, strength, error), left)
    assert limit is not None
    return limit.value


@pytest.mark.parametrize("amplitude", [0.0, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("segments", [4, 48])
def test_the_bound_of_an_amplitude_with_free_phases_holds_at_least_as_often_as_it_says(
    amplitude: float, segments: int
) -> None:
    rng, sigma = np.random.default_rng(2), 0.5
    phases = rng.uniform(0, 2 * np.pi, (4000, segments))
    seen = amplitude * np.stack([np.cos(phases), np.sin(phases)]) + sigma * rng.standard_normal((2, 4000, segments))
    powers = np.sum((seen / sigma) ** 2, axis=(0, 2))
    covered = np.mean([amplitude_bound(p, segments / sigma**2, 2.0 * segments) >= amplitude for p in powers])
    assert covered > 0.95 - 0.02  # the non-central chi-squared is taken as normal


def test_the_bound_of_a_likelihood_holds_at_least_as_often_as_it_says() -> None:
    strengths, true = np.linspace(0.02, 2.0, 100), 0.5
    estimates = true + 0.2 * np.random.default_rng(3).standard_normal(4000)
    bounds = [likelihood_bound(strengths, -((strengths - e) ** 2 - e**2) / (2 * 0.2**2)) for e in estimates]
    assert np.mean(np.array(bounds) >= true) > 0.95 - 3 * math.sqrt(0.95 * 0.05 / 4000)


def test_a_likelihood_that_excludes_no_strength_gives_no_bound() -> None:
    assert math.isnan(likelihood_bound(np.array([0.1, 0.2]), np.array([0.0, 0.1])))


def test_a_limit_is_in_the_parameters_unit() -> None:
    limit = upper_limit(scored(FRICTION, {"friction_force_n": 1e-6}, 2.0, 0.5))
    assert limit is not None
    assert (limit.parameter, limit.unit, limit.probability) == ("friction_force_n", "N", 0.95)
    assert limit.value == pytest.approx(1e-6 * (2.0 + norm.ppf(0.95) * 0.5))


def test_the_limit_of_what_may_have_either_sign_is_of_its_size() -> None:
    values = {q.name: 1e-4 for q in GAIN.parameters}
    assert limit_of(GAIN, values, 2.0, 0.5) == limit_of(GAIN, values, -2.0, 0.5)


def test_what_is_left_over_widens_a_limit() -> None:
    values = {"friction_force_n": 1e-6}
    assert limit_of(FRICTION, values, 2.0, 0.5, left=9.0) > limit_of(FRICTION, values, 2.0, 0.5)


def test_a_body_without_a_strength_is_limited_by_what_is_proportional_to_its_effect() -> None:
    frame = listed("frame_compliance")
    values = {"frame_mass_kg": 1.0, "frame_stiffness_n_per_m": 1e6, "frame_damping_n_s_per_m": 10.0}
    limit = upper_limit(scored(frame, values, 2.0, 0.5))
    assert limit is not None
    assert (limit.parameter, limit.unit) == ("frame_compliance_m_per_n", "m/N")
    assert limit.value == pytest.approx(1e-6 * (2.0 + norm.ppf(0.95) * 0.5))


def test_what_is_free_in_every_segment_has_the_bound_of_its_score() -> None:
    hum = listed("mains_hum")
    limit = upper_limit(scored(hum, {q.name: 1.0 for q in hum.parameters}, 0.0, math.nan, bound=0.02))
    assert limit is not None
    assert (limit.parameter, limit.value) == ("amplitude_m_s2", 0.02)


def test_the_limit_holds_for_every_trial_and_is_none_beyond_the_parameters_range() -> None:
    weak, strong = (scored(FRICTION, {"friction_force_n": f}, 2.0, 0.5) for f in (1e-6, 1e-5))
    (limit,) = upper_limits([weak, strong])
    assert limit == upper_limit(strong)
    assert upper_limits([weak, scored(FRICTION, {"friction_force_n": 1e25}, 2.0, 0.5)]) == ()


@pytest.mark.parametrize(("name", "error"), [("contact_loss", 0.1), ("guide_friction", math.nan)])
def test_what_has_no_strength_or_no_error_has_no_limit(name: str, error: float) -> None:
    mechanism = listed(name)
    assert upper_limit(scored(mechanism, {q.name: 1.0 for q in mechanism.parameters}, 1.0, error)) is None


def test_names_are_less_complete_the_surer_something_is_left() -> None:
    clean, doubtful, left = (complete_probability([0.98], p) for p in (0.5, 0.01, 1e-8))
    assert 0.98 > clean > doubtful > left
    assert left < 1e-4
    assert clean == pytest.approx(0.98 * probability_of_nothing(0.5))


def test_the_rival_of_nothing_is_what_would_gain_most() -> None:
    (rival,) = rivals_of_nothing([("a", 3.0), ("b", 5.0), ("b", 1.0)], 0.4)
    assert rival.ids == ("b",)
    assert rival.probability == pytest.approx((1 - probability_of_nothing(0.4)) / (1 + math.exp(-1)))
