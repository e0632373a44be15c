"""Box-and-whisker numbers, and the impacts of a load combined."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import cbook

from analysis.statistics import box_statistics, combine

samples = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30)


def test_box_of_the_first_nine_numbers_and_an_outlier():
    box = box_statistics([1, 2, 3, 4, 5, 6, 7, 8, 9, 100])
    assert (box.lower_quartile, box.median, box.upper_quartile) == (3.25, 5.5, 7.75)
    assert (box.lower_whisker, box.upper_whisker) == (1, 9)
    assert box.outliers == (100,)


@given(samples)
def test_box_agrees_with_matplotlib(values):
    box = box_statistics(values)
    (peer,) = cbook.boxplot_stats(values)
    assert (box.lower_quartile, box.median, box.upper_quartile) == pytest.approx((peer["q1"], peer["med"], peer["q3"]))
    assert (box.lower_whisker, box.upper_whisker) == pytest.approx((peer["whislo"], peer["whishi"]))
    assert len(box.outliers) == len(peer["fliers"])


def test_box_of_nothing():
    assert box_statistics([]) is None
    assert box_statistics([np.nan]) is None


def test_box_leaves_out_what_is_not_finite():
    assert box_statistics([1.0, np.nan, 3.0]).median == 2.0


REGIMES = {
    "own errors only": (np.full(8, 1.0), 0.0),
    "scatter only": (np.full(8, 0.05), 1.0),
    "both": (np.full(8, 1.0), 1.0),
    "unequal errors": (np.array([0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 3.0]), 0.0),
    "unequal errors and scatter": (np.array([0.5, 0.6, 0.7, 0.8, 1.0, 1.2, 1.5, 2.0]), 0.5),
    "very unequal errors and scatter": (np.array([0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 3.0]), 0.5),
}


@pytest.mark.parametrize("regime", REGIMES)
def test_intervals_of_eight_impacts_cover(regime):
    sigma, tau = REGIMES[regime]
    rng = np.random.default_rng(41)
    draws = 2000
    hits = 0
    for _ in range(draws):
        x = 5.0 + rng.normal(0, np.hypot(sigma, tau))
        estimate = combine(x, sigma)
        hits += estimate.low <= 5.0 <= estimate.high
    assert 0.93 < hits / draws < 0.985


def test_scatter_sets_the_sum_of_squares_to_the_lower_quartile_of_chi_squared():
    x, sigma = np.array([1.0, 4.0, 2.0, 6.0]), np.array([0.3, 0.5, 0.4, 0.6])
    estimate = combine(x, sigma)
    grid = np.linspace(0, 60, 600001)
    weights = 1 / (sigma[:, None] ** 2 + grid)
    mean = (weights * x[:, None]).sum(0) / weights.sum(0)
    squares = (weights * (x[:, None] - mean) ** 2).sum(0)
    at = np.argmin(np.abs(squares - 1.2125))  # lower quartile of chi^2 with 3 degrees of freedom
    assert estimate.value == pytest.approx(mean[at], rel=1e-5)
    assert estimate.standard_error == pytest.approx((1.2125 / 3 / weights[:, at].sum()) ** 0.5, rel=1e-4)
    assert estimate.dof == 3


def test_agreeing_impacts_keep_the_uncertainty_of_their_errors():
    estimate = combine(np.full(8, 3.0), np.full(8, 0.4))
    assert estimate.value == 3.0
    assert estimate.standard_error == pytest.approx(0.4 / np.sqrt(8))
    assert np.isinf(estimate.dof)


def test_one_impact_is_its_own_estimate():
    estimate = combine([3.0], [0.4])
    assert (estimate.value, estimate.standard_error) == (3.0, 0.4)


def test_no_impacts_no_estimate():
    assert combine([], []) is None
    assert combine([np.nan], [1.0]) is None


def test_what_is_not_finite_is_left_out():
    assert combine([1.0, np.nan, 7.0], [0.1, 0.1, np.inf]).value == 1.0


def test_impacts_without_errors_are_a_plain_mean():
    x = np.array([1.0, 2.0, 4.0, 5.0])
    estimate = combine(x, np.zeros(4))
    assert estimate.value == pytest.approx(x.mean())
    assert estimate.standard_error == pytest.approx(x.std(ddof=1) / 2)


def test_equal_impacts_without_errors():
    estimate = combine([2.0, 2.0, 2.0], [0.0, 0.0, 0.0])
    assert (estimate.value, estimate.standard_error) == (2.0, 0.0)


def test_shapes_and_signs_are_checked():
    with pytest.raises(ValueError, match="must be"):
        combine([1.0, 2.0], [1.0])
    with pytest.raises(ValueError, match="negative"):
        combine([1.0, 2.0], [1.0, -1.0])


@given(
    st.lists(st.tuples(st.floats(-10, 10), st.floats(0.01, 5)), min_size=2, max_size=12),
    st.floats(-100, 100),
    st.floats(0.01, 100),
)
def test_shift_and_scale_pass_through(pairs, shift, scale):
    x, sigma = np.array(pairs).T
    plain, moved = combine(x, sigma), combine(shift + scale * x, scale * sigma)
    assert moved.value == pytest.approx(shift + scale * plain.value, rel=1e-6, abs=1e-5 * scale)
    assert moved.half_width == pytest.approx(scale * plain.half_width, rel=1e-4)
    assert min(x) - 1e-9 <= plain.value <= max(x) + 1e-9
