"""The line of one calibration, and the test for drift between two."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import stats

from calibration.line import CalibrationError, compare, fit_line
from daq.records import CalibrationPoints

WEIGHTS = np.array([0.0, 100, 200, 400, 600, 800, 1000])
UP_DOWN = np.concatenate([WEIGHTS, WEIGHTS[::-1]])
SENSITIVITY, OFFSET = 0.042, 0.35


def points(load, voltage, time="2024-05-01T08:00:00Z"):
    return CalibrationPoints(np.asarray(load, float), np.asarray(voltage, float), time)


def noisy(rng, load=UP_DOWN, offset=OFFSET, sensitivity=SENSITIVITY, noise=0.02):
    return points(load, offset + sensitivity * load + rng.normal(0, noise, len(load)))


def test_line_through_exact_points():
    fit = fit_line(points(WEIGHTS, OFFSET + SENSITIVITY * WEIGHTS), 0.0)
    assert fit.sensitivity_mv_per_mn.value == pytest.approx(SENSITIVITY, rel=1e-12)
    assert fit.offset_mv.value == pytest.approx(OFFSET, rel=1e-12)
    assert fit.residual_std_mv < 1e-13
    assert fit.dof == 5
    assert not fit.curved


def test_line_and_errors_agree_with_linregress():
    calibration = noisy(np.random.default_rng(1))
    fit = fit_line(calibration, 0.0)
    peer = stats.linregress(calibration.load_mn, calibration.voltage_mv)
    assert fit.sensitivity_mv_per_mn.value == pytest.approx(peer.slope)
    assert fit.sensitivity_mv_per_mn.standard_error == pytest.approx(peer.stderr)
    assert fit.offset_mv.value == pytest.approx(peer.intercept)
    assert fit.offset_mv.standard_error == pytest.approx(peer.intercept_stderr)
    assert fit.offset_mv.dof == pytest.approx(len(UP_DOWN) - 2)


def test_covariance_agrees_with_polyfit():
    calibration = noisy(np.random.default_rng(2))
    fit = fit_line(calibration, 0.0)
    _, covariance = np.polyfit(calibration.load_mn, calibration.voltage_mv, 1, cov=True)
    np.testing.assert_allclose(fit.covariance, covariance[::-1, ::-1], rtol=1e-9)


def test_two_points_have_the_uncertainty_of_their_weights():
    fit = fit_line(points([0, 1000], [OFFSET, OFFSET + 1000 * SENSITIVITY]), 0.1)
    assert fit.dof == 0
    assert fit.sensitivity_mv_per_mn.standard_error == pytest.approx(SENSITIVITY * 0.1 / 1000)
    assert fit.offset_mv.standard_error == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(("noise", "weight_error"), [(0.02, 0.0), (0.001, 0.1), (0.005, 0.1)])
def test_intervals_of_the_line_cover(noise, weight_error):
    rng = np.random.default_rng(3)
    hits = np.zeros(2)
    draws = 1500
    for _ in range(draws):
        errors = rng.normal(0, weight_error, len(WEIGHTS)) * (WEIGHTS > 0)
        hung = np.concatenate([WEIGHTS + errors, (WEIGHTS + errors)[::-1]])
        voltage = OFFSET + SENSITIVITY * hung + rng.normal(0, noise, len(hung))
        fit = fit_line(points(UP_DOWN, voltage), weight_error)
        hits[0] += fit.sensitivity_mv_per_mn.low <= SENSITIVITY <= fit.sensitivity_mv_per_mn.high
        hits[1] += fit.offset_mv.low <= OFFSET <= fit.offset_mv.high
    assert (hits / draws > 0.93).all()
    assert (hits / draws < 0.975).all()


def test_nonlinearity_of_a_parabola():
    x = WEIGHTS / 1000
    bow = 4 * x * (1 - x)  # 1 at half range, 0 at the ends
    fit = fit_line(points(WEIGHTS, 42 * x + 0.42 * bow), 0.0)
    line = np.polyval(np.polyfit(WEIGHTS, 42 * x + 0.42 * bow, 1), WEIGHTS)
    expected = 100 * np.max(np.abs(42 * x + 0.42 * bow - line)) / np.ptp(line)
    assert fit.nonlinearity_percent == pytest.approx(expected)
    assert fit.curved


def test_curvature_is_found_at_its_level_only():
    rng = np.random.default_rng(4)
    p_values = [fit_line(noisy(rng), 0.0).curvature_p_value for _ in range(1000)]
    assert stats.kstest(p_values, "uniform").pvalue > 0.01


def test_curvature_of_uncertain_weights_is_not_the_gauges():
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(600):
        errors = rng.normal(0, 0.5, len(WEIGHTS)) * (WEIGHTS > 0)
        hung = np.concatenate([WEIGHTS + errors, (WEIGHTS + errors)[::-1]])
        voltage = SENSITIVITY * hung + rng.normal(0, 0.002, len(hung))
        found += fit_line(points(UP_DOWN, voltage), 0.5, level=0.05).curved
    assert found / 600 < 0.08


@pytest.mark.parametrize(
    ("load", "voltage", "words"),
    [
        ([0, 100], [1.0], "one voltage belongs"),
        ([[0, 100]], [[0, 4.2]], "one voltage belongs"),
        ([100, 100, 100], [4.2, 4.2, 4.3], "two different weights"),
        ([], [], "two different weights"),
        ([0, 100, np.nan], [0, 4.2, 8.4], "point 3"),
        ([0, 100, 200], [0, np.inf, 8.4], "point 2"),
        ([0, 1e300, 2e300], [0, 4.2, 8.4], "beyond"),
        ([0, 1e-300, 2e-300], [0, 4.2, 8.4], "two different weights"),
        ([0, 100, 200], [0, -4.2, -8.4], "does not rise"),
        ([0, 100, 200], [1, 1, 1], "does not rise"),
        ([0, 100, 200, 300], [0, 5, -4, 4], "does not follow"),
    ],
)
def test_unfit_points_are_refused(load, voltage, words):
    with pytest.raises(CalibrationError, match=words) as caught:
        fit_line(points(load, voltage), 0.1)
    assert "\n" not in str(caught.value)


def test_words_are_no_calibration():
    bad = CalibrationPoints(np.array(["a", "b"]), np.array([0.0, 1.0]), "")
    with pytest.raises(CalibrationError, match="not numbers"):
        fit_line(bad, 0.1)


@pytest.mark.parametrize("load", [UP_DOWN, WEIGHTS[[0, 3, 6]]])
def test_drift_p_values_are_uniform_without_drift(load):
    rng = np.random.default_rng(6)
    p_values = [compare(noisy(rng, load), noisy(rng, load), 0.01).p_value for _ in range(1000)]
    assert stats.kstest(p_values, "uniform").pvalue > 0.01


@pytest.mark.parametrize(("offset", "sensitivity"), [(OFFSET + 0.1, SENSITIVITY), (OFFSET, SENSITIVITY * 1.005)])
def test_drift_is_found(offset, sensitivity):
    rng = np.random.default_rng(7)
    found = [compare(noisy(rng), noisy(rng, offset=offset, sensitivity=sensitivity), 0.01).drifted for _ in range(200)]
    assert np.mean(found) > 0.99


def test_false_alarms_with_uncertain_weights_stay_below_the_level():
    rng = np.random.default_rng(8)
    found = 0
    for _ in range(500):
        errors = rng.normal(0, 0.3, len(WEIGHTS))
        hung = np.concatenate([WEIGHTS + errors, (WEIGHTS + errors)[::-1]])
        pair = [points(UP_DOWN, SENSITIVITY * hung + rng.normal(0, 0.01, len(hung))) for _ in range(2)]
        found += compare(*pair, 0.05).drifted
    assert found / 500 < 0.07


def test_equal_points_without_scatter_have_not_drifted():
    exact = points(WEIGHTS, OFFSET + SENSITIVITY * WEIGHTS)
    verdict = compare(exact, exact, 0.01)
    assert verdict.p_value == 1.0
    assert not verdict.drifted


def test_different_points_without_scatter_have_drifted():
    verdict = compare(
        points(WEIGHTS, OFFSET + SENSITIVITY * WEIGHTS), points(WEIGHTS, OFFSET + 0.05 + SENSITIVITY * WEIGHTS), 0.01
    )
    assert verdict.p_value == 0.0
    assert verdict.drifted
    assert "no scatter at all" in verdict.statement


def test_two_points_each_give_no_verdict():
    verdict = compare(points([0, 1000], [0, 42.0]), points([0, 1000], [1, 43.0]), 0.01)
    assert verdict.p_value is None
    assert not verdict.drifted
    assert "no scatter to judge" in verdict.statement


def test_statement_says_what_changed():
    verdict = compare(
        points(WEIGHTS, 0.042 * WEIGHTS), points(WEIGHTS, 0.21 + 0.042 * WEIGHTS), 0.01
    )  # 0.21 mV are 5 mN
    assert "+5.00 mN" in verdict.statement
    assert "differ" in verdict.statement


@example(1.0, 0.0, [0.0, 2.0, 9.5e-211, 2.2e-309])  # two weights, not four
@given(
    st.floats(1e-4, 1e2),
    st.floats(-100, 100),
    st.lists(st.floats(0, 1e4), min_size=3, max_size=12, unique=True).filter(lambda w: np.ptp(w) > 1),
)
def test_an_exact_line_is_recovered(sensitivity, offset, weights):
    load = np.array(weights)
    fit = fit_line(points(load, offset + sensitivity * load), 0.1)
    span = abs(offset) + sensitivity * np.ptp(load)
    assert fit.scale.voltage_mv(float(load[0])) == pytest.approx(offset + sensitivity * load[0], abs=1e-6 * span)
    assert fit.nonlinearity_percent < 1e-3
