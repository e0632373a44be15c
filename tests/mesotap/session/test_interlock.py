"""The interlock under faults: the load limit is never passed by more than one allowed step, and every exit is safe."""

from __future__ import annotations

import itertools

import pytest

from mesotap.session.bench import simulated_rig
from mesotap.session.states import State
from rig import GaugeScale, InterlockRefusal, LoadReading, RigError, StaleReading
from rig.interlock import Interlock
from tests.mesotap.benches import new_runner, small_config

STATES = [
    State.PRE_CALIBRATION,
    State.APPROACH,
    State.SET_LOAD,
    State.LOCK,
    State.TAP,
    State.RETRACT,
    State.POST_CALIBRATION,
]
FAULTS = [
    "frozen",
    "dropout",
    "nan",
    "late",
    ("scale", 0.3),
    ("scale", 0.7),
    ("scale", -1.0),
    ("offset", -20.0),
    ("offset", 20.0),
]
DEAD = ("scale", 0.0)  # shows the empty gauge, noise and all
HIGH_UM = 50.0


def allowed_mn(config) -> float:
    k1, k2 = config.rig.spring_stiffness()
    step = config.rig.limits.largest_approach_step_um * k1 * k2 / (k1 + k2) * 1e-3
    return config.rig.limits.load_mn + step


class FaultIn:
    """Breaks the gauge at its n-th reading within a state of the runner."""

    def __init__(self, rig, state: State, reading: int, fault) -> None:
        self.rig, self.state, self.left, self.fault = rig, state, reading, fault
        self.runner = None
        self.read = rig.load_cell.read
        rig.load_cell.read = self

    def __call__(self, duration_s: float = 0.1):
        if self.runner is not None and self.runner.progress.state is self.state:
            if self.left == 0:
                self.rig.load_cell.fault = self.fault
            self.left -= 1
        return self.read(duration_s)


def run_with(tmp_path, config, state, reading, fault):
    rig = simulated_rig(config)
    breaker = FaultIn(rig, state, reading, fault)
    folder, runner = new_runner(tmp_path / "session", config, rig)
    breaker.runner = runner
    error = None
    with folder:
        try:
            runner.run()
        except RigError as caught:
            error = caught
        impacts = folder.impacts()
    return rig, error, impacts


@pytest.mark.parametrize("fault", FAULTS, ids=str)
@pytest.mark.parametrize("state", STATES, ids=lambda s: s.name)
@pytest.mark.parametrize("higher_um", [0.0, pytest.param(HIGH_UM, marks=pytest.mark.slow)])
@pytest.mark.parametrize("reading", [0, pytest.param(3, marks=pytest.mark.slow)])
def test_limit_holds_whatever_the_gauge_does(tmp_path, state, fault, higher_um, reading):
    config = small_config(f"sim_backend.contact_position_um={150.0 - higher_um}")
    rig, error, _ = run_with(tmp_path, config, state, reading, fault)
    assert rig.peak_true_load_mn <= allowed_mn(config)
    assert rig.true_load_mn() == 0.0, "the surfaces are not apart"
    assert not rig.stage.read().locked
    assert reading or rig.load_cell.fault == fault, "the fault never happened"
    if error is not None:
        assert str(error).count("\n") == 0
        assert len(str(error)) > 20


@pytest.mark.parametrize("state", STATES, ids=lambda s: s.name)
def test_limit_holds_with_a_gauge_that_shows_nothing(tmp_path, state):
    config = small_config()
    rig, error, _ = run_with(tmp_path, config, state, 1, DEAD)
    assert rig.peak_true_load_mn <= allowed_mn(config)
    assert rig.true_load_mn() == 0.0
    if state in (State.APPROACH, State.SET_LOAD):
        assert isinstance(error, RigError)


@pytest.mark.parametrize("fault", ["frozen", "dropout", "nan", "late"])
def test_a_gauge_that_fails_while_loading_is_named(tmp_path, fault):
    config = small_config()
    _, error, _ = run_with(tmp_path, config, State.SET_LOAD, 2, fault)
    assert isinstance(error, StaleReading)
    assert "gauge" in str(error)


def test_contact_higher_than_expected_is_found(tmp_path):
    config = small_config(f"sim_backend.contact_position_um={150.0 - HIGH_UM}")
    rig, error, impacts = run_with(tmp_path, config, State.DONE, 0, None)
    assert error is None
    assert sum(s.accepted for s in impacts) == 4
    assert rig.peak_true_load_mn <= config.rig.limits.load_mn


def interlock_of(config):
    rig = simulated_rig(config)
    rig.open()
    true = rig.true_parameters()["sensitivity_mv_per_mn"]
    scale = GaugeScale(true, config.sim_backend.gauge.offset_mv)
    return rig, Interlock(rig, config.rig.limits, scale, config.rig.spring_stiffness())


def test_contact_lower_than_the_search_is_refused_with_what_to_do():
    config = small_config("sim_backend.contact_position_um=160")
    rig, interlock = interlock_of(config)
    with pytest.raises(InterlockRefusal, match="expected_contact_um"), interlock:
        interlock.approach()
    assert rig.true_load_mn() == 0.0


def test_no_step_is_made_at_the_limit():
    config = small_config()
    rig, interlock = interlock_of(config)
    with interlock:
        interlock.approach()
        interlock.set_load(1085.0, 10.0)
        for _ in range(20):
            try:
                interlock.move_by(0.5)
            except InterlockRefusal:
                break
    assert rig.peak_true_load_mn <= config.rig.limits.load_mn + 5.0  # the gauge's noise and calibration


def test_a_target_past_the_limit_is_refused_before_anything_moves():
    config = small_config()
    rig, interlock = interlock_of(config)
    with interlock:
        interlock.approach()
        before = rig.stage.read().position_um
        with pytest.raises(InterlockRefusal, match="past the limit"):
            interlock.set_load(1200.0, 5.0)
        assert rig.stage.read().position_um == before


def test_every_exit_takes_the_surfaces_apart():
    config = small_config()
    rig, interlock = interlock_of(config)
    with pytest.raises(ZeroDivisionError), interlock:
        interlock.approach()
        interlock.set_load(500.0, 10.0)
        interlock.lock()
        assert rig.true_load_mn() > 400.0
        1 / 0  # noqa: B018
    assert rig.true_load_mn() == 0.0


def test_a_stage_that_cannot_retract_is_told_and_not_hidden():
    config = small_config()
    rig, interlock = interlock_of(config)

    def stuck(travel_um, aim=""):
        raise RigError("stage: motor stalled")

    with pytest.raises(RigError, match=r"motor stalled.*by hand"), interlock:
        interlock.approach()
        rig.stage.retract = stuck


# --- stages and gauges as they are sold


@pytest.mark.parametrize("backlash_um", [0.0, 2.0, 5.0])
def test_a_load_is_set_in_few_steps_with_the_steps_of_an_actuator(backlash_um):
    """900 mN within 28: half of what 0.2 um (TRA12CC, CMA25CCL) makes on these springs; up, and down and up again."""
    config = small_config(f"sim_backend.stage={{resolution_um: 0.2, backlash_um: {backlash_um}, speed_um_per_s: 50.0}}")
    rig, interlock = interlock_of(config)
    moves = []
    move_by = rig.stage.move_by
    rig.stage.move_by = lambda step_um, aim="": moves.append(step_um) or move_by(step_um, aim)
    with interlock:
        interlock.approach()
        for target, most in ((900.0, 10), (500.0, 35), (900.0, 10)):
            moves.clear()
            assert interlock.set_load(target, 28.0) == pytest.approx(target, abs=28.0)
            assert rig.true_load_mn() == pytest.approx(target, abs=30.0)
            assert len(moves) <= most
            assert moves[-1] > 0
    assert rig.peak_true_load_mn <= 900.0 + 30.0


def test_no_step_of_the_approach_is_larger_than_allowed():
    config = small_config("sim_backend.stage={resolution_um: 0.2, backlash_um: 0, speed_um_per_s: 50.0}")
    rig, interlock = interlock_of(config)
    places = []
    begin = rig.stage.begin
    rig.stage.begin = lambda *where: (places.append(rig.stage.knob_um), begin(*where))[1]
    with interlock:
        interlock.approach()
        places.append(rig.stage.knob_um)
        assert max(b - a for a, b in itertools.pairwise(places)) <= 0.5


def test_a_step_is_never_rounded_up_by_the_stage():
    """0.5 um asked of a stage with steps of 0.2 um: 0.4, not the 0.6 that it would round to from some places."""
    config = small_config("sim_backend.stage={resolution_um: 0.2, backlash_um: 0, speed_um_per_s: 50.0}")
    rig, interlock = interlock_of(config)
    with interlock:
        interlock.approach()
        for _ in range(4):
            before = rig.stage.read().position_um
            interlock.move_by(0.5)
            assert rig.stage.read().position_um - before == pytest.approx(0.4)


class Rounded:
    """An amplifier that filters and shows whole divisions of 1 mN, as a Laumas does."""

    def __init__(self, rig, quantum_mn: float = 1.0) -> None:
        self.read = rig.load_cell.read
        self.quantum_mv = 0.042 * quantum_mn
        self.held: float | None = None
        self.stuck = False
        rig.load_cell.read = self

    def __call__(self, duration_s: float = 0.1) -> LoadReading:
        reading = self.read(duration_s)
        if not self.stuck or self.held is None:
            self.held = round(reading.voltage_mv / self.quantum_mv) * self.quantum_mv
        return LoadReading(reading.time_s, self.held, 0.0, reading.samples, self.quantum_mv)


def test_a_gauge_of_whole_divisions_is_not_taken_for_a_dead_one(tmp_path):
    """Noise of 0.05 mN under divisions of 1 mN: the same number for as long as the stage stands."""
    config = small_config("sim_backend.gauge.noise_mv=0.0021", "sim_backend.gauge.offset_mv=0.359")
    rig = simulated_rig(config)
    Rounded(rig)
    folder, runner = new_runner(tmp_path / "session", config, rig)
    with folder:
        runner.run()
        assert sum(impact.accepted for impact in folder.impacts()) == 4


@pytest.mark.parametrize("at_mn", [100.0, 500.0])
def test_a_gauge_of_whole_divisions_that_stands_still_while_the_stage_goes_on_is_dead(at_mn):
    config = small_config("sim_backend.gauge.noise_mv=0.0021")
    rig, interlock = interlock_of(config)
    rounded = Rounded(rig)
    with pytest.raises(StaleReading, match="the same to the last digit"), interlock:
        interlock.approach()
        interlock.set_load(at_mn, 10.0)
        rounded.stuck = True
        for _ in range(20):
            interlock.move_by(0.1)
    assert rig.peak_true_load_mn <= at_mn + 10.0 + 4 * 0.1 * 277
    assert rig.true_load_mn() == 0.0
