"""A walk between its observations."""

import numpy as np
import pytest
from scipy import stats

from calibration.random_walk import RandomWalk


def test_between_two_exact_observations_it_is_a_bridge():
    walk = RandomWalk([0.0, 2.0], [0.0, 1.0], [0.0, 0.0], 0.0, 1.0)
    assert walk.weights(0.5) == pytest.approx([0.75, 0.25])
    # rate 1 / 2 h; variance of a bridge t (T - t) / T
    assert walk.variance(0.5) == pytest.approx(0.5 * 0.5 * 1.5 / 2)
    assert walk.variance(2.0) == pytest.approx(0.0, abs=1e-9)


def test_observations_that_only_scatter_are_averaged():
    walk = RandomWalk([0.0, 1.0, 2.0], [0.1, -0.1, 0.05], [1.0, 1.0, 1.0], 1e-3, 10.0)
    assert walk.weights(1.0) == pytest.approx([1 / 3] * 3, abs=1e-3)


@pytest.mark.parametrize("n", [3, 12])
def test_its_rate_is_found_and_trusted_by_the_number_of_increments(n):
    rng = np.random.default_rng(5)
    rates, dofs = [], []
    for _ in range(400):
        values = np.cumsum(rng.normal(0, 0.5, n))
        walk = RandomWalk(np.arange(n), values, np.zeros(n), 0.01, None)
        rates.append(walk.rate_variance)
        dofs.append(walk.dof)
    assert np.mean(rates) == pytest.approx(0.25, rel=0.25)
    # increments where there are few observations, else errors of predictions from neighbours, which are correlated
    assert np.median(dofs) == pytest.approx(2 if n == 3 else 10 / 1.94, rel=0.2)


def test_what_is_declared_holds_until_more_is_seen():
    assert RandomWalk([0.0], [1.0], [0.0], 0.3, 10.0).variance(4.0) == pytest.approx(0.09 * 4)


def test_one_increment_of_a_walk_of_which_nothing_is_known_is_as_good_as_one_degree_of_freedom():
    walk = RandomWalk([0.0, 2.0], [0.0, 1.0], [0.0, 0.0], 1e-3, None)
    # midway, rate 1 / 2 h and Student's t: 12.7 sqrt(0.5 x 0.5)
    half_width = stats.t.ppf(0.975, walk.dof) * np.sqrt(walk.variance(1.0))
    assert half_width == pytest.approx(12.7 * 0.5, rel=0.1)


def test_what_was_seen_elsewhere_makes_its_rate_known():
    def narrow(rates):
        return -0.5 * (np.log(rates / 0.04) / 0.1) ** 2

    walk = RandomWalk([0.0, 2.0], [0.0, 1.0], [0.0, 0.0], 1e-3, None, narrow)
    assert walk.rate_variance == pytest.approx(0.04, rel=0.15)
    assert walk.dof > 20


def test_observations_at_one_time_are_no_reason_to_fail():
    walk = RandomWalk([0.0, 0.0, 1.0], [1.0, 1.1, 1.0], [0.01, 0.01, 0.01], 0.1, None)
    assert np.sum(walk.weights(0.5)) == pytest.approx(1.0)


def test_a_walk_that_does_not_move_weighs_observations_by_their_noise():
    walk = RandomWalk([0.0, 2.0], [0.0, 1e-6], [1.0, 4.0], 0.0, 1.0)
    assert walk.rate_variance == 0.0
    assert walk.weights(0.1) == pytest.approx([0.8, 0.2])


@pytest.mark.parametrize(("smooth", "low", "high"), [(False, 0.92, 0.985), (True, 0.95, 1.0)])
def test_predictions_hold_for_a_walk_and_for_a_smooth_drift(smooth, low, high):
    rng = np.random.default_rng(8)
    hits, narrower = 0, []
    for _ in range(400):
        fine = np.linspace(0, 2, 201)
        drift = np.cumsum(rng.normal(0, 0.05, 201))
        if smooth:
            drift = 1.2 * np.exp(-0.5 * ((fine - rng.uniform(0.6, 1.4)) / 0.3) ** 2)
        at = np.arange(0, 201, 20)
        walk = RandomWalk(fine[at], drift[at] + rng.normal(0, 0.01, at.size), np.full(at.size, 1e-4), 0.05, None)
        i = int(rng.integers(0, 201))
        predicted = float(walk.weights(fine[i]) @ (drift[at]))
        width = stats.t.ppf(0.975, walk.dof) * np.sqrt(walk.variance(fine[i]) + 1e-4)
        hits += abs(predicted - drift[i]) <= width
        # of a bridge over 0.2 h, midway, by the rate of the increments
        narrower.append(np.sqrt(walk.variance(fine[10]) / (walk.rate_variance * 0.05)))
    assert low < hits / 400 <= high
    assert np.median(narrower) == pytest.approx(1.0, abs=0.2) if not smooth else np.median(narrower) < 0.7
