"""A walk between its observations."""

import numpy as np
import pytest

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
        walk = RandomWalk(np.arange(n), values, np.zeros(n), 0.01, 0.25)
        rates.append(walk.rate_variance)
        dofs.append(walk.dof)
    assert np.mean(rates) == pytest.approx(0.25, rel=0.25)
    assert np.median(dofs) == pytest.approx(n - 1, rel=0.2)


def test_what_is_declared_holds_until_more_is_seen():
    assert RandomWalk([0.0], [1.0], [0.0], 0.3, 10.0).variance(4.0) == pytest.approx(0.09 * 4)


def test_observations_at_one_time_are_no_reason_to_fail():
    walk = RandomWalk([0.0, 0.0, 1.0], [1.0, 1.1, 1.0], [0.01, 0.01, 0.01], 0.1, 0.25)
    assert np.sum(walk.weights(0.5)) == pytest.approx(1.0)


def test_a_walk_that_does_not_move_weighs_observations_by_their_noise():
    walk = RandomWalk([0.0, 2.0], [0.0, 1e-6], [1.0, 4.0], 0.0, 1.0)
    assert walk.rate_variance == 0.0
    assert walk.weights(0.1) == pytest.approx([0.8, 0.2])
