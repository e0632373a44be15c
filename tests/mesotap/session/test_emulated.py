"""Whole sessions with the real drivers on emulated wires: the same to the last bit as on the simulated rig."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from daq.journal import SessionFolder
from mesotap.commands import session as commands
from mesotap.configuration.config import parse_config
from mesotap.session.bench import emulated_rig, simulated_rig
from mesotap.session.emulated_devices import separate_rig
from mesotap.session.runner import SessionRunner
from mesotap.session.states import State
from rig import RigError
from rig.drivers.assembly import assemble
from tests.mesotap.benches import Silent, new_runner, runner_in, small_config
from tests.mesotap.session.separate import CONFIG
from tests.mesotap.session.test_killed import accepted, child, content, finish, silent

TCP = "rig.parts.load_cell={driver: modbus-tcp, preset: seneca-ze-sg3, host: 192.168.1.5}"
SMC = "rig.parts.stage={driver: smc100, port: /dev/ttyUSB1, zero_mm: 1.5, resolution_um: 0.02}"
MILLIVOLTS = (
    "rig.parts.load_cell={driver: modbus-tcp, host: h, registers: {signal: {offset: 2, kind: float32}, signal_is: mv, "
    "word_order: low_first, table: input}}"
)
LOAD = (
    "rig.parts.load_cell={driver: modbus-rtu, port: p, excitation_v: 3.3, registers: {signal: {offset: 65, "
    "kind: float32}, signal_is: load, ratio: {offset: 13, kind: float32}, full_scale: {offset: 15, kind: float32}}}"
)
LAUMAS = "rig.parts.load_cell={driver: modbus-rtu, port: p, preset: laumas-tlb, settling_s: 0}"
FLOAT32 = 2.0**-23  # relative step of a float32
LARGEST_MV = 64.0


def session(path: Path, config, rig) -> tuple[list, list, dict]:
    """Impacts and journal of a whole session, the rig's own state left out."""
    folder, runner = new_runner(path, config, rig)
    with folder:
        runner.run()
        events = [{k: v for k, v in event.items() if k != "rig"} for event in folder.events()]
        return folder.impacts(), events, rig.checkpoint()


def same(one, other) -> None:
    assert one[1] == other[1]
    assert len(one[0]) == len(other[0]) > 0
    for a, b in zip(one[0], other[0], strict=True):
        assert np.array_equal(a.acceleration, b.acceleration)
        assert np.array_equal(a.strain_mv, b.strain_mv)
        assert (a.load_before_mn, a.load_after_mn, a.time, a.accepted) == (
            b.load_before_mn,
            b.load_after_mn,
            b.time,
            b.accepted,
        )


DRIFTING = "sim_backend.gauge.drift_mv_per_hour=8"


CHANGES = ((), (TCP, SMC), (MILLIVOLTS,), (LAUMAS,), (DRIFTING,))


@pytest.mark.parametrize(
    ("changes", "wires"),
    [
        *((changes, False) for changes in CHANGES),
        *(pytest.param(changes, True, marks=pytest.mark.slow if changes else ()) for changes in CHANGES),
    ],
    ids=str,
)
def test_the_emulated_session_is_the_simulated_one(tmp_path, changes, wires):
    config = small_config(*changes)
    simulated = simulated_rig(config, seed=5)
    rig = emulated_rig(config, seed=5, wires=wires)
    first, second = session(tmp_path / "a", config, simulated), session(tmp_path / "b", config, rig)
    same(first, second)
    devices = second[2].pop("devices")
    assert devices["controller"]["referenced"]
    for state in (first[2], second[2]):
        state["load_cell"].pop("last_voltage_mv")  # of the simulated gauge's own mean, which the driver takes here
    assert first[2] == second[2], "rigs differ afterwards: time, places, random generators"
    assert not [p for p in rig.ports if getattr(p, "path", None) is not None and p.path.exists()]


def test_a_load_in_float32_is_the_same_within_its_step(tmp_path):
    """Loads of a register in N are rounded to float32: 2**-23 of the voltage, far below the noise of 0.02 mV."""
    config = small_config(LOAD)
    rigs = simulated_rig(config, seed=5), emulated_rig(config, seed=5)
    readings = []
    for rig in rigs:
        rig.open()
        rig.stage.move_by(151.0)
        readings.append([rig.load_cell.read().voltage_mv for _ in range(20)])
        rig.close()
    assert readings[0] != readings[1]
    assert np.max(np.abs(np.subtract(*readings))) < FLOAT32 * LARGEST_MV


def test_the_hand_turned_micrometer_works_with_the_drivers(tmp_path):
    config = small_config("rig.parts.stage=hand", "mesotap.load_tolerance_mn=15")
    same(
        session(tmp_path / "a", config, simulated_rig(config, seed=5)),
        session(tmp_path / "b", config, emulated_rig(config, seed=5)),
    )


def test_nothing_but_moves_and_the_motor_is_ever_told_to_the_stage(tmp_path):
    config = small_config()
    rig = emulated_rig(config)
    session(tmp_path / "a", config, rig)
    told = {line.strip("0123456789.-?")[:2] for line in rig.controller.sent}
    assert told == {"VE", "HT", "VA", "SL", "SR", "TS", "TP", "TE", "PA", "MM", "ST"}


def test_an_emulated_session_goes_on_from_its_journal(tmp_path, monkeypatch):
    config = small_config()
    whole = session(tmp_path / "whole", config, emulated_rig(config, seed=5))

    class Stop:
        runner: SessionRunner | None = None

        def check(self, hold) -> None:
            if self.runner is not None and self.runner.progress.state is State.TAP:
                raise KeyError("killed")

    control = Stop()
    monkeypatch.setattr(SessionRunner, "_leave_safely", lambda self, error: None)
    folder, runner = new_runner(tmp_path / "broken", config, emulated_rig(config, seed=5), control=control)
    control.runner = runner
    with folder:
        with pytest.raises(KeyError):
            runner.run()
        runner_in(folder, config, emulated_rig(config, seed=5)).run()
        impacts = folder.impacts()
    assert [s.acceleration.tobytes() for s in impacts] == [s.acceleration.tobytes() for s in whole[0]]


def test_a_simulated_session_is_not_resumed_on_emulated_devices():
    config = small_config()
    with pytest.raises(RigError, match="not of an emulated rig"):
        emulated_rig(config).restore(simulated_rig(config).checkpoint())


QUICK = [
    "mesotap.load_plan_mn=[300, 500]",
    "mesotap.impacts_per_load=3",
    "calibration.weights_mn=[0, 500, 1000]",
    "daq.trigger.record_samples=2000",
]


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_killed_session_on_ptys_ends_as_the_simulated_one(tmp_path):
    """SIGKILL within real wires: the file at the end is that of an unbroken session on the simulated rig."""
    commands.run(None, QUICK, commands.RigChoice(simulate=True, seed=7), tmp_path / "whole", None, silent())
    expected = content(tmp_path / "whole" / "session.h5")
    broken = tmp_path / "broken"

    def begin() -> None:
        commands.run(None, QUICK, commands.RigChoice(emulate=True, seed=7), broken, None, silent())

    def resume() -> None:
        commands.resume(broken, None, silent())

    pid = child(begin)
    for wanted in (1, 3, 5):
        while len(list((broken / "shots").glob("*.h5")) if broken.exists() else []) < wanted:
            assert os.waitpid(pid, os.WNOHANG) == (0, 0), "it ended before it was killed"
        os.kill(pid, signal.SIGKILL)
        assert finish(pid) == -signal.SIGKILL
        kept = accepted(broken)
        assert kept
        pid = child(resume)
    assert finish(pid) == 0
    assert accepted(broken).items() >= kept.items()
    assert content(broken / "session.h5") == expected


def test_a_rig_without_devices_says_which_are_missing():
    config = small_config()
    with pytest.raises(RigError, match=r"rig.parts.load_cell \(now simulated\), .*add --simulate"):
        assemble(config.rig, Silent())


REAL = (
    "rig.parts.load_cell={driver: modbus-tcp, preset: seneca-ze-sg3, host: 127.0.0.1, tcp_port: 1}",
    "rig.parts.stage={driver: conex-cc, port: /nowhere/ttyUSB1, resolution_um: 0.02}",
    "rig.parts.accelerometers={driver: usb-1608fs-plus}",
)


def test_a_real_rig_names_every_device_that_does_not_answer(tmp_path):
    config = small_config(*REAL)
    folder, runner = new_runner(tmp_path / "s", config, assemble(config.rig, Silent()))
    with folder, pytest.raises(RigError) as refused:
        runner.run()
    said = str(refused.value)
    for part in ("micrometer stage on /nowhere/ttyUSB1", "strain-gauge amplifier on 127.0.0.1:1", "1608FS"):
        assert part in said
    assert any("nothing was moved" in note for note in refused.value.__notes__)
    with SessionFolder.open(tmp_path / "s") as kept:
        assert kept.events()[-1]["event"] == "safe"


def test_a_hand_turned_rig_is_assembled_too():
    config = small_config(REAL[0], REAL[2], "rig.parts.stage=hand")
    rig = assemble(config.rig, Silent())
    assert rig.stage.read().locked is False
    assert np.isnan(rig.stage.read().position_um)
    assert len(rig.drivers()) == 2


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # they outlive who started them
def test_devices_that_ended_are_a_fault_of_the_rig_and_not_an_output_that_nobody_reads(tmp_path):
    # a broken pipe would end the command without a word
    rig = separate_rig(parse_config(CONFIG, "config.yaml"), Silent(), 5, tmp_path)
    rig.end_devices()
    with pytest.raises(RigError, match="has ended"):
        for _ in range(2400):
            rig.devices.call("ports")
            time.sleep(0.05)
    rig.end_devices()
