"""What the order of a calibration's readings tells of the drift of the zero."""

import numpy as np
import pytest

from calibration.gauge import GaugeHistory
from calibration.settings import CalibrationSettings
from calibration.within import WithinCalibrations
from daq.records import CalibrationPoints

WEIGHTS = np.array([0.0, 100, 200, 400, 600, 800, 1000])
UP_DOWN = np.concatenate([WEIGHTS, WEIGHTS[::-1]])
SECONDS = np.arange(14) * 45.0
RATES = np.geomspace(1e-4, 10, 61) ** 2
NOISE_MV = 0.003
EIGHT, NINE, TEN = "2024-05-01T08:00:00Z", "2024-05-01T09:00:00Z", "2024-05-01T10:00:00Z"


def timed(time, voltage, elapsed=SECONDS):
    return CalibrationPoints(UP_DOWN, voltage, time, elapsed_s=elapsed)


def a_day(rng, rate_mv):
    """Two calibrations two hours apart of a gauge that walks, and its zero halfway and at the end."""
    steps = rng.normal(0, 1, 14 + 14 + 2) * rate_mv
    first = np.cumsum(steps[:14]) * np.sqrt(45 / 3600)
    half = first[-1] + steps[28] * np.sqrt(0.9)
    end = half + steps[29] * np.sqrt(0.9) + np.cumsum(steps[14:28]) * np.sqrt(45 / 3600)
    voltages = [0.042 * UP_DOWN + drift + rng.normal(0, NOISE_MV, 14) for drift in (first, end)]
    return [timed(t, v) for t, v in zip((EIGHT, TEN), voltages, strict=True)], half


def test_the_rate_of_a_walk_is_seen_in_the_readings():
    rng = np.random.default_rng(3)
    total = sum(WithinCalibrations(a_day(rng, 0.05)[0]).log_likelihood(RATES) for _ in range(60))
    assert np.sqrt(RATES[np.argmax(total)]) == pytest.approx(0.05, rel=0.15)


def test_a_gauge_that_stands_still_is_not_taken_for_one_that_wanders():
    rng = np.random.default_rng(4)
    total = sum(WithinCalibrations(a_day(rng, 0.0)[0]).log_likelihood(RATES) for _ in range(60))
    assert np.sqrt(RATES[np.argmax(total)]) < 0.005
    assert total[0] - total[np.searchsorted(RATES, 0.02**2)] > 20


def test_lines_weights_and_loops_change_nothing_of_it():
    rng = np.random.default_rng(5)
    plain, _ = a_day(rng, 0.02)
    off = rng.normal(0, 0.5, 7)
    off = np.concatenate([off, off[::-1]])
    loop = np.concatenate([-np.sin(np.pi * WEIGHTS / 1000), np.sin(np.pi * WEIGHTS[::-1] / 1000)])
    changed = [
        timed(p.time, p.voltage_mv + off + loop + level + slope * UP_DOWN)
        for p, level, slope in zip(plain, (0.3, -2.0), (0.001, 0.002), strict=True)
    ]
    expected = WithinCalibrations(plain).log_likelihood(RATES)
    assert WithinCalibrations(changed).log_likelihood(RATES) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("elapsed", [None, SECONDS[:5], SECONDS * np.nan], ids=["unknown", "too few", "no numbers"])
def test_without_times_nothing_is_told(elapsed):
    calibrations = [timed(p.time, p.voltage_mv, elapsed) for p in a_day(np.random.default_rng(6), 0.05)[0]]
    within = WithinCalibrations(calibrations)
    assert within.contrasts == 0
    assert not within.log_likelihood(RATES).any()


def test_readings_without_any_scatter_tell_nothing():
    assert WithinCalibrations([timed(EIGHT, 0.042 * UP_DOWN), timed(TEN, 0.042 * UP_DOWN)]).contrasts == 0


@pytest.mark.slow
def test_loads_of_a_gauge_that_wanders_are_held_more_often_and_by_shorter_intervals():
    rng = np.random.default_rng(7)
    settings = CalibrationSettings(gravity_m_s2=9.81)
    inside, widths = np.zeros((300, 2), bool), np.zeros((300, 2))
    for i in range(300):
        calibrations, half = a_day(rng, 0.042 * 0.6)
        without = [timed(p.time, p.voltage_mv, None) for p in calibrations]
        for j, points in enumerate((without, calibrations)):
            load = GaugeHistory(*points, settings).load_at(0.042 * 500 + half, NINE, NOISE_MV)
            inside[i, j], widths[i, j] = load.low <= 500 <= load.high, load.half_width
    assert inside[:, 1].mean() > max(0.90, inside[:, 0].mean())
    assert np.median(widths[:, 1]) < 0.85 * np.median(widths[:, 0])
