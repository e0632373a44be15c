"""Calibrating with dead weights, against a small rig of its own."""

import numpy as np
import pytest

from calibration.line import fit_line
from calibration.routine import calibrate, check_points
from calibration.settings import CalibrationSettings
from daq.records import CalibrationPoints
from rig.errors import RigError, StaleReading
from rig.interface import Clock, DeadWeights, LoadCell, Rig
from rig.readings import LoadReading

SETTINGS = CalibrationSettings(weights_mn=(0, 500, 100, 1000), repeats=2, averaging_s=0.5)


class Bench(Rig):
    """A gauge, weights and a clock."""

    name = "bench"

    def __init__(self, sensitivity=0.042, spread=0.02, fail_at=None, stuck=False):
        self.now_s = 0.0
        self.hanging = 0.0
        self.log = []
        self.rng = np.random.default_rng(21)
        bench = self

        class BenchClock(Clock):
            def now(self):
                return bench.now_s

            def sleep(self, seconds):
                bench.now_s += seconds

            def utc(self):
                return f"2024-05-01T08:00:{bench.now_s:06.3f}Z"

        class Gauge(LoadCell):
            def read(self, duration_s=0.1):
                bench.now_s += duration_s
                if fail_at is not None and bench.hanging == fail_at:
                    raise RigError("the gauge does not answer")
                voltage = 0.35 + sensitivity * bench.hanging + bench.rng.normal(0, 0.002)
                return LoadReading(bench.now_s, voltage, spread, 100)

        class Weights(DeadWeights):
            def place(self, load_mn):
                if stuck and load_mn == 0.0 and bench.log:
                    raise RigError("the hook is jammed")
                bench.hanging = load_mn
                bench.log.append(load_mn)

        self.clock, self.load_cell, self.weights = BenchClock(), Gauge(), Weights()

    def open(self):
        return []

    def close(self):
        pass


def test_weights_go_up_then_down_and_come_off():
    bench = Bench()
    points = calibrate(bench, SETTINGS, lambda text: None)
    assert points.load_mn.tolist() == [0, 100, 500, 1000, 1000, 500, 100, 0]
    assert bench.log == [0, 100, 500, 1000, 1000, 500, 100, 0, 0]


def test_the_time_of_each_reading_is_kept():
    points = calibrate(Bench(), SETTINGS, lambda text: None)  # readings of 0.5 s
    assert points.elapsed_s == pytest.approx(0.5 * np.arange(8))


def test_a_clock_that_is_set_back_gives_no_times(monkeypatch):
    bench = Bench()
    monkeypatch.setattr(bench.clock, "utc", lambda: f"2024-05-01T08:00:{59 - bench.now_s:06.3f}Z")
    assert calibrate(bench, SETTINGS, lambda text: None).elapsed_s is None


def test_the_gauge_is_recovered():
    points = calibrate(Bench(), SETTINGS, lambda text: None)
    fit = fit_line(points, 0.0)
    assert fit.sensitivity_mv_per_mn.low < 0.042 < fit.sensitivity_mv_per_mn.high
    assert check_points(points, SETTINGS, 0.042) == []


def test_the_time_is_halfway_through():
    points = calibrate(Bench(), SETTINGS, lambda text: None)  # 8 readings of 0.5 s
    assert points.time == "2024-05-01T08:00:02.000Z"


def test_progress_and_operator_are_told():
    told, seen = [], []
    calibrate(Bench(), SETTINGS, told.append, lambda done, of: seen.append((done, of)))
    assert seen == [(i, 8) for i in range(1, 9)]
    assert "1000 mN" in told[0]


@pytest.mark.parametrize("error", [RigError, KeyboardInterrupt])
def test_weights_come_off_on_every_exit(error):
    bench = Bench(fail_at=500)

    def progress(done, of):
        if error is KeyboardInterrupt:
            raise KeyboardInterrupt

    with pytest.raises(error):
        calibrate(bench, SETTINGS, lambda text: None, progress)
    assert bench.hanging == 0.0


def test_a_jammed_hook_does_not_hide_the_first_error():
    told = []
    with pytest.raises(RigError, match="does not answer"):
        calibrate(Bench(fail_at=500, stuck=True), SETTINGS, told.append)
    assert "may still hang" in told[-1]


def test_a_frozen_gauge_ends_the_calibration():
    bench = Bench(spread=0.0)
    with pytest.raises(StaleReading, match="all the same"):
        calibrate(bench, SETTINGS, lambda text: None)
    assert bench.hanging == 0.0


def test_complaint_about_the_sensitivity():
    points = calibrate(Bench(sensitivity=0.05), SETTINGS, lambda text: None)
    (complaint,) = check_points(points, SETTINGS, 0.042)
    assert "% above the 0.042 mV/mN" in complaint


def test_complaint_about_nonlinearity():
    load = np.array([0, 100, 200, 400, 600, 800, 1000.0])
    noise = np.random.default_rng(22).normal(0, 0.001, 7)
    points = CalibrationPoints(load, 0.042 * load + 3e-6 * load**2 + noise, "")
    (complaint,) = check_points(points, SETTINGS, 0.045)
    assert "departs from a line" in complaint


def test_complaint_about_a_gauge_without_noise():
    load = np.array([0, 500, 1000, 1000, 500, 0.0])
    (complaint,) = check_points(CalibrationPoints(load, 0.042 * load, ""), SETTINGS, 0.042)
    assert "no noise at all" in complaint


def test_no_complaint_about_a_gauge_that_rounds_its_noise_away():
    load = np.array([0, 500, 1000, 1000, 500, 0.0])
    assert check_points(CalibrationPoints(load, 0.042 * load, "", quantum_mv=0.042), SETTINGS, 0.042) == []


def test_complaint_about_a_frozen_gauge():
    load = np.array([0, 500, 1000.0])
    (complaint,) = check_points(CalibrationPoints(load, np.full(3, 0.35), ""), SETTINGS, 0.042)
    assert "frozen" in complaint


def test_complaint_about_no_calibration():
    (complaint,) = check_points(CalibrationPoints(np.array([1.0]), np.array([1.0]), ""), SETTINGS, 0.042)
    assert "two different weights" in complaint
