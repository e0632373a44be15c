"""Leaving a rig: nothing interrupts it, what is said is what was seen, and nothing that fails hides anything."""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import subprocess
import sys

import pytest

from daq.journal import SessionFolder
from mesotap.operator.console import KeyControl
from mesotap.session.bench import emulated_rig, simulated_rig
from mesotap.session.guardian import ARMED, Guardian
from mesotap.session.guardian_link import GuardianProcess
from mesotap.session.states import State
from rig import DeviceError, GaugeScale, LoadReading, RigError, RigFailures, SessionAborted, StaleReading
from rig.assembled import AssembledRig
from rig.drivers.driver import Driver
from rig.drivers.solenoid import SolenoidImpactor
from rig.interlock import Interlock
from tests.faults.bench import FaultyBench, quick_config
from tests.mesotap.benches import new_runner, runner_in, small_config
from tests.mesotap.session.test_session import Interrupt


class KeptPressing(Interrupt):
    """An operator who presses Ctrl-C again and again from some moment on."""

    def check(self, hold) -> None:
        if self.left <= 0:
            raise self.error
        super().check(hold)


@pytest.mark.parametrize("state", [State.APPROACH, State.SET_LOAD, State.LOCK, State.TAP, State.RETRACT])
def test_who_ends_a_session_twice_does_not_stop_its_retraction(tmp_path, state):
    config = small_config()
    rig = simulated_rig(config)
    control = KeptPressing(SessionAborted("Ctrl-C"), state, 2 if state is not State.RETRACT else 1)
    folder, runner = new_runner(tmp_path / "s", config, rig, control=control)
    control.runner = runner
    with folder, pytest.raises(SessionAborted) as ended:
        runner.run()
    assert rig.true_load_mn() == 0.0
    assert any("the surfaces are apart" in note for note in ended.value.__notes__)


def test_a_control_interrupts_once(monkeypatch):
    control = KeyControl(None)
    monkeypatch.setattr(control, "_ended", "SIGHUP")
    with pytest.raises(SessionAborted, match="ended by SIGHUP"):
        control.check()
    control.check()


def interlock_of(rig, config) -> Interlock:
    truth = rig.physics.true_parameters() if hasattr(rig, "physics") else rig.true_parameters()
    scale = GaugeScale(truth["sensitivity_mv_per_mn"], config.sim_backend.gauge.offset_mv)
    return Interlock(rig, config.rig.limits, scale, config.rig.spring_stiffness())


def loaded(*changes: str):
    config = small_config(*changes)
    rig = simulated_rig(config)
    interlock = interlock_of(rig, config)
    interlock.approach()
    interlock.set_load(500.0, 6.0)
    interlock.lock()
    return rig, interlock


def test_apart_is_said_when_the_gauge_saw_it():
    _, interlock = loaded()
    assert interlock.make_safe().sentence() == "the surfaces are apart"


@pytest.mark.parametrize(("fault", "says"), [("dropout", "is silent"), ("nan", "is silent"), ("frozen", "is silent")])
def test_apart_is_not_said_of_a_gauge_that_saw_nothing(fault, says):
    rig, interlock = loaded()
    rig.load_cell.fault = fault
    safe = interlock.make_safe()
    assert rig.true_load_mn() == 0.0
    assert safe.sentence() == f"moved back 100 um, but the gauge {says}: look whether the surfaces are apart"


def test_a_gauge_that_contradicted_the_stage_is_no_witness_afterwards():
    rig, interlock = loaded()
    rig.load_cell.fault = ("offset", -10.0)
    with pytest.raises(StaleReading, match="while the stage stood still"):
        interlock.move_by(0.1, load_mn=500.0)
    assert "cannot be believed" in interlock.make_safe().sentence()


def test_a_coupling_that_slips_is_seen_by_the_gauge():
    """Motor and encoder turn, the screw does not: the load stays, and nobody is told that the surfaces are apart."""
    rig, interlock = loaded()
    micrometer = rig.micrometer
    keep_up = micrometer._keep_up

    def slipping() -> None:
        carriage = micrometer._carriage_um
        keep_up()
        micrometer._carriage_um = carriage

    micrometer._keep_up = slipping
    safe = interlock.make_safe()
    assert rig.true_load_mn() > 400.0
    assert "the gauge still shows" in safe.sentence()
    assert "by hand" in safe.sentence()


def test_a_stage_that_moves_by_itself_ends_the_session():
    rig, interlock = loaded()
    rig.micrometer.clamp(False)
    rig.micrometer.begin(rig.micrometer.knob_um - 3.0)
    rig.clock.sleep(1.0)
    with pytest.raises(RigError, match="its clamp has opened by itself"):
        interlock.look_at_stage()
    rig.micrometer.clamp(True)
    with pytest.raises(RigError, match=r"it was left at .* by itself"):
        interlock.look_at_stage()


def test_a_tap_during_a_look_is_no_overload():
    """One reading swings over the limit, a longer one does not: that is a tap."""
    rig, interlock = loaded()
    read = rig.load_cell.read

    def swinging(duration_s=0.1):
        reading = read(duration_s)
        swing = 40.0 if duration_s < 0.05 else 0.0
        return LoadReading(reading.time_s, reading.voltage_mv + swing, reading.spread_mv, reading.samples)

    rig.load_cell.read = swinging
    interlock.look_at_gauge(taps=True)
    with pytest.raises(RigError, match="over the limit"):
        interlock.look_at_gauge(taps=False)


# --- time


def test_a_reading_is_as_old_as_its_sample(tmp_path):
    """The program is stopped for a minute between the sample and the end of the call."""
    config = small_config()
    rig = emulated_rig(config)
    rig.open()
    interlock = interlock_of(rig, config)
    sample = rig.load_cell._sample
    held = [False]

    def stopped():
        voltage = sample()
        if held[0]:
            rig.clock.sleep(60.0)
        return voltage

    rig.load_cell._sample = stopped
    interlock.load_mn()
    held[0] = True
    with pytest.raises(StaleReading, match=r"the last reading is \d+\.\d+ s old"):
        interlock.load_mn()


@pytest.mark.parametrize("leaning_um", [0.0, 2.0])
def test_a_standstill_between_reading_and_step_is_noticed(leaning_um):
    """The program stands still for a minute before the stage is told to move; meanwhile somebody may lean on it."""
    rig, interlock = loaded()
    go_to = rig.micrometer._go_to

    def late(*arguments):
        rig.clock.sleep(60.0)
        rig.push(leaning_um)
        return go_to(*arguments)

    rig.stage.unlock()
    rig.micrometer._go_to = late
    before = rig.micrometer.knob_um
    if leaning_um:
        with pytest.raises(StaleReading, match="while the stage stood still"):
            interlock.move_by(0.1)
        assert rig.micrometer.knob_um == before
    else:
        readings = rig.load_cell._rng.bit_generator.state["state"]["state"]
        interlock.move_by(0.1)
        assert rig.load_cell._rng.bit_generator.state["state"]["state"] != readings
        assert rig.micrometer.knob_um > before


# --- devices that are gone


@pytest.mark.parametrize("gone", ["recorder", "amplifier", "both"])
def test_resuming_takes_the_load_off_before_it_complains(tmp_path, gone):
    bench = FaultyBench(tmp_path / "s", quick_config())
    bench.when(State.TAP, 1, 1, bench.kill)
    bench.run()
    bench.mend()
    assert bench.rig.physics.true_load_mn() > 800.0
    if gone != "amplifier":
        bench.recorder.bus.unplug(bench.recorder)
    if gone != "recorder":
        bench.amplifier_wire.plugged = False
    outcome = bench.run()
    assert bench.rig.physics.true_load_mn() == 0.0
    said = outcome.reads
    assert ("1608FS-Plus" in said) == (gone != "amplifier")
    assert ("strain-gauge amplifier" in said) == (gone != "recorder")
    assert "nothing was moved" not in said
    assert ("look whether the surfaces are apart" in said) == (gone != "recorder")
    bench.mend()
    assert bench.run().error is None
    assert len(bench.accepted()) == 4


def test_another_controller_at_the_stages_port_is_never_moved(tmp_path):
    bench = FaultyBench(tmp_path / "s", quick_config())
    bench.when(State.TAP, 1, 1, bench.kill)
    bench.run()
    bench.mend()
    bench.controller.version = "SMC_CC 3.1.2"
    load = bench.rig.physics.true_load_mn()
    outcome = bench.run()
    assert bench.rig.physics.true_load_mn() == load
    assert "by hand" in outcome.reads


# --- errors


class Part(Driver):
    def __init__(self, error: Exception | None = None) -> None:
        self.error, self.closed = error, False

    def connect(self) -> str:
        return "here"

    def close(self) -> None:
        self.closed = True
        if self.error is not None:
            raise self.error


def test_what_fails_while_closing_keeps_nobody_from_closing():
    stage, recorder = Part(OSError("EIO")), Part()
    rig = AssembledRig("rig", None, Part(), stage, recorder, None, None)
    with pytest.raises(RigError, match="while closing: EIO"):
        rig.close()
    assert recorder.closed


def test_what_fails_while_closing_hides_nothing(tmp_path):
    config = small_config()
    rig = simulated_rig(config)

    def broken() -> None:
        raise RigError("while closing: EIO")

    rig.close = broken
    control = Interrupt(SessionAborted("ended by the operator"), State.TAP, 2)
    folder, runner = new_runner(tmp_path / "s", config, rig, control=control)
    control.runner = runner
    with folder, pytest.raises(SessionAborted, match="ended by the operator") as ended:
        runner.run()
    notes = ended.value.__notes__
    assert any("the surfaces are apart" in note for note in notes)
    assert any("EIO" in note for note in notes)


def test_several_failures_are_a_group_each_with_its_device():
    class Broken(Part):
        def connect(self) -> str:
            raise DeviceError("stage", "/dev/ttyX", "silent", "check its cable")

    rig = AssembledRig("rig", None, Broken(), Broken(), Part(), None, None)
    with pytest.raises(RigFailures) as failed:
        rig.open()
    assert [error.device for error in failed.value.exceptions] == ["stage", "stage"]
    assert str(failed.value).count("check its cable") == 2


# --- the solenoid


class Lines:
    def __init__(self) -> None:
        self.high: dict[int, bool] = {3: True}  # as a program that was killed left it
        self.fails = False

    def set_line(self, line: int, high: bool) -> None:
        if self.fails:
            raise RigError("recorder: it is gone")
        self.high[line] = high


def test_a_solenoid_that_was_left_on_is_switched_off_when_the_rig_is_opened():
    config = quick_config("rig.parts.impactor={driver: solenoid, line: 3}")
    lines = Lines()
    impactor = SolenoidImpactor(lines, config.rig.parts.impactor, None)
    AssembledRig("rig", None, Part(), Part(), Part(), impactor, None).open()
    assert not lines.high[3]


def test_a_solenoid_that_may_be_on_is_told():
    config = quick_config("rig.parts.impactor={driver: solenoid, line: 3}")
    lines = Lines()
    impactor = SolenoidImpactor(lines, config.rig.parts.impactor, None)
    impactor.release()
    lines.fails = True
    impactor.release()  # known to be off
    impactor._may_be_on = True
    with pytest.raises(RigError, match="may still be under current"):
        impactor.release()


# --- where contact is looked for


def test_contact_is_looked_for_again_where_it_was(tmp_path):
    """A gauge that died with its noise since the last contact, and a stage with far to go: 12.9 N before."""
    config = small_config("rig.limits.expected_contact_um=200", "sim_backend.contact_position_um=150")
    rig = simulated_rig(config)
    interlock = interlock_of(rig, config)
    interlock.approach()
    interlock.set_load(300.0, 6.0)
    assert math.isfinite(interlock.contact[0])
    assert interlock.make_safe().sentence() == "the surfaces are apart"
    rig.load_cell.fault = ("scale", 0.0)
    with pytest.raises(RigError, match=r"no contact up to 160\.5 um"):
        interlock.approach()
    assert rig.peak_true_load_mn < 2500.0


def test_where_contact_was_is_known_after_a_resume(tmp_path):
    config = small_config("rig.limits.expected_contact_um=200", "sim_backend.contact_position_um=150")
    control = Interrupt(SessionAborted("ended"), State.TAP)
    folder, runner = new_runner(tmp_path / "s", config, control=control)
    control.runner = runner
    with folder, pytest.raises(SessionAborted):
        runner.run()
    with SessionFolder.open(tmp_path / "s") as folder:
        runner = runner_in(folder, config, simulated_rig(config))
        assert runner.progress.felt_before is not None
        runner._interlock.expect_contact(runner.progress.felt_before)
        assert runner._interlock._travel.reach_um() < 161.0


class Guarding(Guardian):
    """Remembers what it was told."""

    def __init__(self) -> None:
        self.told: list[object] = []
        self.beats = 0

    def start(self) -> None:
        self.told.append("start")

    def arm(self, load: bool) -> None:
        self.told.append(load)

    def beat(self) -> None:
        self.beats += 1

    def dismiss(self) -> None:
        self.told.append("dismiss")


def test_a_guardian_is_armed_before_contact_and_dismissed_apart(tmp_path):
    config = small_config()
    folder, runner = new_runner(tmp_path / "s", config)
    guardian = Guarding()
    object.__setattr__(runner._bench, "guardian", guardian)
    with folder:
        runner.run()
    assert guardian.told == ["start", True, False, "dismiss"]
    assert guardian.beats > 100


def test_a_guardian_that_is_killed_is_replaced_and_delays_no_exit(tmp_path):
    """Its process is killed under load: the next sign of life starts another one, which knows that there is a load."""
    config = quick_config()
    with SessionFolder.create(tmp_path / "s", {"config": "", "created": ""}) as folder:
        rig = AssembledRig("rig", None, Part(), Part(), Part(), None, None)
        guardian = GuardianProcess(config.rig, rig, folder)
        guardian.start()
        guardian.arm(True)
        first = guardian._process
        first.kill()
        first.wait()
        guardian._beat_s = 0.0
        guardian.beat()
        second = guardian._process
        assert second is not first
        assert second.poll() is None
        assert guardian._heard(ARMED)
        os.kill(second.pid, signal.SIGSTOP)  # one that hangs is none
        guardian._heard_s = guardian._beat_s = -1e9
        guardian.beat()
        third = guardian._process
        assert third is not second
        assert second.poll() == -signal.SIGKILL
        third.kill()
        third.wait()
        guardian.leave()
        guardian.arm(False)
        assert guardian._process is third
        guardian.dismiss()
        assert guardian._process is None


@pytest.mark.slow
def test_a_guardian_whose_session_died_before_it_began_takes_over(tmp_path):
    """Setup and the word that there is a load wait in its socket; its session is gone when it reads them."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    setup = {"rig": quick_config().rig.model_dump(mode="json"), "folder": None, "scale": [0.042, 0.0], "bus": None}
    setup |= {"descriptors": [], "travel_um": [-200.0, 11800.0], "stage_round_trip_s": 0.0}
    ours.send(json.dumps(setup).encode())
    ours.send(json.dumps({"state": ARMED}).encode())
    ours.close()
    command = [sys.executable, "-m", "mesotap.session.guardian_process", str(theirs.fileno()), str(gone.pid)]
    told = subprocess.run(command, pass_fds=[theirs.fileno()], capture_output=True, text=True, check=False).stderr
    theirs.close()
    assert "mesotap guardian: the program died; not made safe" in told
    assert "/dev/ttyUSB1" in told


def test_a_jump_of_the_gauge_in_the_approach_costs_no_session(tmp_path):
    """Contact felt in the air, by a gauge that is sound again later: the session goes on where the surfaces meet."""
    bench = FaultyBench(tmp_path / "s", quick_config())
    gauge = bench.rig.physics.load_cell

    def jump() -> None:
        gauge.fault = ("offset", 2.0)
        bench.after(1.5, lambda: setattr(gauge, "fault", None))

    bench.when(State.APPROACH, 0, 12, jump)
    outcome = bench.run()
    assert outcome.error is not None
    bench.mend()
    for _ in range(2):
        outcome = bench.run()
    assert outcome.error is None, outcome.reads
    assert len(bench.accepted()) == 4


def test_wires_too_slow_to_watch_the_load_by_are_told(tmp_path):
    bench = FaultyBench(tmp_path / "s", quick_config(), round_trip_s=0.1)
    outcome = bench.run()
    assert "wires: a look at gauge and stage takes 0.43 s (replies of 100 and 100 ms)" in outcome.reads
