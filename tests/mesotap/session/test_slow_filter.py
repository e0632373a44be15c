"""An amplifier that averages over longer than a step takes: declared, it is waited for; if not, it is found out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mesotap.session.bench import simulated_rig
from mesotap.session.states import State
from rig import GaugeScale, InterlockRefusal, LoadReading, RigError, StaleReading
from rig.interlock import Interlock
from rig.settling import MOST_TURNS, let_settle
from sim_backend.clock import VirtualClock
from sim_backend.emulators.rig import EmulatedRig
from tests.mesotap.benches import new_runner, small_config
from tests.mesotap.session.test_interlock import allowed_mn

TICK_S = 0.01
TLB = "rig.parts.load_cell={driver: modbus-rtu, preset: laumas-tlb, port: /dev/ttyUSB0, mv_per_count: 0.0042}"


class Lagging:
    """A first-order filter on the true voltage, carried on with every tick of the rig's clock."""

    def __init__(self, rig, lag_s: float, settling_s: float, noise_mv: float = 0.003) -> None:
        self.rig, self.lag_s, self.noise_mv = rig, lag_s, noise_mv
        self.rng = np.random.default_rng(8)
        self.filtered_mv = rig.load_cell.true_voltage()
        self.sleep, self.sleep_until = rig.clock.sleep, rig.clock.sleep_until
        rig.clock.sleep = self.pass_time
        rig.clock.sleep_until = lambda time_s: self.pass_time(time_s - rig.clock.now())
        rig.load_cell.read, rig.load_cell.settling_s = self.read, settling_s

    def pass_time(self, seconds: float) -> None:
        while seconds > 0.0:
            tick = min(TICK_S, seconds)
            self.sleep(tick)
            seconds -= tick
            kept = math.exp(-tick / self.lag_s)
            self.filtered_mv = kept * self.filtered_mv + (1 - kept) * self.rig.load_cell.true_voltage()

    def read(self, duration_s: float = 0.1) -> LoadReading:
        values = []
        for _ in range(max(2, round(duration_s / TICK_S))):
            self.pass_time(TICK_S)
            values.append(self.filtered_mv + self.noise_mv * self.rng.standard_normal())
        return LoadReading(self.rig.clock.now(), float(np.mean(values)), float(np.std(values, ddof=1)), len(values))


# --- waiting ---------------------------------------------------------------------------------------------------


class Exponential:
    """A reading that goes from one voltage to another with a time constant."""

    def __init__(self, lag_s: float, change_mv: float, drift_mv_per_s: float = 0.0) -> None:
        self.clock = VirtualClock()
        self.lag_s, self.change_mv, self.drift = lag_s, change_mv, drift_mv_per_s

    def left_mv(self) -> float:
        return self.change_mv * math.exp(-self.clock.now() / self.lag_s)

    def read(self) -> LoadReading:
        self.clock.sleep(0.05)
        now = self.clock.now()
        return LoadReading(now, self.change_mv - self.left_mv() + self.drift * now, 0.0, 5)


@pytest.mark.parametrize("change_mv", [0.5, 40.0])
@pytest.mark.parametrize("lag_s", [0.1, 0.85, 3.0])
def test_it_waits_until_what_is_left_does_not_matter(lag_s, change_mv):
    gauge = Exponential(lag_s, change_mv)
    assert let_settle(gauge.clock, lag_s, gauge.read, within_mv=0.06)
    assert gauge.left_mv() <= 0.06 / (math.e - 1) * 1.05, "x(e - 1) is what the last settling time changed"


def test_no_filter_costs_neither_time_nor_a_reading():
    gauge = Exponential(0.1, 1.0)
    assert let_settle(gauge.clock, 0.0, gauge.read)
    assert gauge.clock.now() == 0.0


def test_what_never_comes_to_rest_is_told_after_ten_settling_times():
    gauge = Exponential(0.5, 1.0, drift_mv_per_s=1.0)
    assert not let_settle(gauge.clock, 0.5, gauge.read, within_mv=0.06)
    assert gauge.clock.now() == pytest.approx(MOST_TURNS * 0.5, rel=0.2)


# --- sessions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lag_s", [0.15, 0.85, 2.0])
def test_a_session_with_a_declared_filter_sets_its_loads(tmp_path, lag_s):
    config = small_config()
    rig = simulated_rig(config, seed=3)
    Lagging(rig, lag_s, settling_s=lag_s)
    folder, runner = new_runner(tmp_path / "session", config, rig)
    true_mn: list[float] = []
    lock = rig.stage.lock
    rig.stage.lock = lambda: (true_mn.append(rig.true_load_mn()), lock())[1]
    with folder:
        runner.run()
        impacts = folder.impacts()
    tolerance = config.mesotap.load_tolerance_mn
    assert sum(impact.accepted for impact in impacts) == config.mesotap.impacts_per_load * len(
        config.mesotap.load_plan_mn
    )
    told_mn = [e["load_mn"] for e in folder.events() if e["event"] == "loaded"]
    assert len(told_mn) == len(true_mn) >= len(config.mesotap.load_plan_mn)
    assert told_mn == pytest.approx(true_mn, abs=2 * tolerance)
    assert rig.peak_true_load_mn <= allowed_mn(config)


@pytest.mark.parametrize("declared_s", [0.0, 0.1])
@pytest.mark.parametrize("lag_s", [0.85, 3.0])
def test_a_filter_that_nobody_declared_is_found_out_and_the_limit_holds(tmp_path, lag_s, declared_s):
    config = small_config()
    rig = simulated_rig(config, seed=3)
    Lagging(rig, lag_s, settling_s=declared_s)
    folder, runner = new_runner(tmp_path / "session", config, rig)
    with folder, pytest.raises(RigError) as told:
        runner.run()
    assert "settling_s" in str(told.value) or "disagree" in str(told.value) or "calibration" in str(told.value)
    assert rig.peak_true_load_mn <= allowed_mn(config)
    assert rig.true_load_mn() == 0.0


def test_a_load_over_the_limit_is_not_waited_out():
    config = small_config()
    rig = simulated_rig(config, seed=3)
    scale = GaugeScale(rig.load_cell.true_sensitivity(), rig.load_cell.true_voltage())
    lagging = Lagging(rig, 0.85, settling_s=0.85)
    interlock = Interlock(rig, config.rig.limits, scale, config.rig.spring_stiffness())
    interlock.approach()
    interlock.set_load(600.0, 6.0)
    begun = rig.clock.now()
    moved = rig.stage.move_by

    def lean(step_um: float, aim: str = ""):
        reading = moved(step_um, aim)
        rig.push(5.0)
        return reading

    rig.stage.move_by = lean
    with pytest.raises((InterlockRefusal, StaleReading)):
        interlock.move_by(0.2)
    assert rig.clock.now() - begun < 0.85 + 0.5
    assert lagging.filtered_mv < scale.sensitivity_mv_per_mn * rig.true_load_mn() + scale.offset_mv


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
def test_a_laumas_as_delivered_carries_a_session_out(tmp_path, seed):
    config = small_config(TLB, "rig.parts.stage={driver: conex-cc, port: /dev/ttyUSB1, resolution_um: 0.02}")
    rig = EmulatedRig(config.rig, config.sim_backend, seed=seed, realistic=True)
    assert rig.load_cell.settling_s == 0.85
    folder, runner = new_runner(tmp_path / "session", config, rig)
    with folder:
        assert runner.run().state is State.FILE
    assert rig.physics.peak_true_load_mn <= allowed_mn(config)
