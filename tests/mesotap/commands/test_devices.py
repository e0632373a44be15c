"""``devices`` and ``check``: what is connected, and a verdict a line."""

from __future__ import annotations

import io
import json

import pytest
from rich.console import Console

from mesotap.commands.devices import check, devices
from mesotap.session.bench import emulated_rig, simulated_rig
from mesotap.session.self_test import self_test
from rig import RigError
from rig.drivers.newport_codes import PositionerError
from tests.mesotap.benches import small_config

REAL = [
    "rig.parts.load_cell={driver: modbus-tcp, preset: seneca-ze-sg3, host: 127.0.0.1, tcp_port: 1}",
    "rig.parts.stage={driver: conex-cc, port: /nowhere/ttyUSB1, resolution_um: 0.02, home_at_connect: true}",
]
ALL = ["mechanical stop", "noise floor", "gauge zero", "stage step", "tap"]


def told(command, tmp_path, *changes, **how) -> tuple[list[str], dict]:
    out = io.StringIO()
    chosen = {"simulate": False, "emulate": False, "seed": 3, **how}
    answer = tmp_path / "answer.json"
    try:
        command(None, list(changes), json_path=answer, console=Console(file=out, width=300), **chosen)
    finally:
        lines = out.getvalue().splitlines()
    return lines, json.loads(answer.read_text())


@pytest.mark.parametrize("how", ["simulate", "emulate"])
def test_a_good_rig_passes_every_line(tmp_path, how):
    lines, answer = told(check, tmp_path, "rig.limits.mechanical_stop_um=4", touch=True, **{how: True})
    assert answer["passed"]
    assert [v["name"] for v in answer["verdicts"] if v["name"] != "connection"] == ALL
    assert all(line.startswith("good") for line in lines)
    assert len(lines) == len(answer["verdicts"])


def test_the_drivers_verdicts_are_those_of_the_simulated_rig():
    config = small_config()
    said = []
    for rig in (simulated_rig(config, seed=3), emulated_rig(config, seed=3)):
        rig.open()
        said.append(list(self_test(rig, config)))
        rig.close()
    assert said[0] == said[1]


def test_without_touching_there_is_no_tap(tmp_path):
    _, answer = told(check, tmp_path, emulate=True, touch=False)
    assert answer["verdicts"][-1] == {"name": "tap", "passed": None, "says": "left out, as asked"}
    assert answer["passed"]


def make_noise(rig) -> None:
    take = rig.physics.accelerometers.signal.take
    rig.physics.accelerometers.signal.take = lambda n: 200 * take(n)


def unplug(rig) -> None:
    rig.recorder.inject("unplug", rig.clock.now())


FAULTS = {
    "dead accelerometer": (
        lambda rig: setattr(rig.physics.accelerometers.signal, "take", _silence(rig)),
        "noise floor",
        "A shows nothing at all",
    ),
    "noisy bench": (make_noise, "noise floor", "wait until the bench is quiet"),
    "recorder gone": (unplug, "noise floor", "gone from the bus"),
    "frozen gauge": (lambda rig: setattr(rig.amplifier, "fault", "frozen"), "gauge zero", "readings are the same"),
    "silent gauge": (lambda rig: setattr(rig.amplifier, "fault", 4), "gauge zero", "Modbus exception 4"),
    "stalled": (lambda rig: setattr(rig.controller, "stalled", True), "stage step", "did not follow"),
    "following": (
        lambda rig: setattr(rig.controller, "fails_next", PositionerError.FOLLOWING),
        "stage step",
        "did not follow",
    ),
}


def _silence(rig):
    take = rig.physics.accelerometers.signal.take

    def taken(samples):
        volts = take(samples)
        volts[0] = 0.0
        return volts

    return taken


@pytest.mark.parametrize("name", FAULTS)
def test_what_is_broken_is_named(name):
    break_it, where, says = FAULTS[name]
    config = small_config()
    rig = emulated_rig(config, seed=3)
    rig.open()
    break_it(rig)
    verdicts = []
    try:
        for verdict in self_test(rig, config):
            verdicts.append(verdict)
    except RigError as error:
        assert name == "stalled", error  # what cannot be taken apart is told besides
    bad = {v.name: v.says for v in verdicts if v.passed is False}
    assert where in bad
    assert says in bad[where]
    assert rig.physics.true_load_mn() == 0.0
    if where == "gauge zero":
        assert [v.passed for v in verdicts if v.name in ("stage step", "tap")] == [None, None]
        assert not [line for line in rig.controller.sent if line.startswith("1PA")], "it moved without a gauge"


def test_a_contact_that_is_elsewhere_fails_the_tap_and_leaves_the_surfaces_apart():
    config = small_config("sim_backend.contact_position_um=170")
    rig = emulated_rig(config, seed=3)
    rig.open()
    verdicts = list(self_test(rig, config))
    rig.close()
    assert verdicts[-1].passed is False
    assert "expected_contact_um" in verdicts[-1].says
    assert rig.physics.true_load_mn() == 0.0


def test_a_bad_check_ends_in_one_sentence(tmp_path):
    with pytest.raises(RigError, match="check: 1 of 1 did not pass: connection"):
        told(check, tmp_path, *REAL, "rig.parts.accelerometers={driver: usb-1608fs-plus}", touch=True)
    answer = json.loads((tmp_path / "answer.json").read_text())
    assert not answer["passed"]
    assert "/nowhere/ttyUSB1" in answer["verdicts"][0]["says"]


@pytest.mark.parametrize("how", ["simulate", "emulate"])
def test_every_part_of_a_rig_that_is_not_there_answers(tmp_path, how):
    lines, answer = told(devices, tmp_path, **{how: True})
    assert all(part["answers"] for part in answer["parts"])
    assert len(lines) == len(answer["parts"]) >= 3


def test_each_configured_device_is_asked_by_itself(tmp_path, monkeypatch):
    monkeypatch.setattr("mesotap.commands.devices._serial_ports", lambda: [{"port": "/dev/ttyS9", "says": "a port"}])
    monkeypatch.setattr("mesotap.commands.devices._recorders", list)
    monkeypatch.setattr("mesotap.commands.devices._ni_modules", lambda: [{"port": "cDAQ1Mod1", "says": "NI 9234"}])
    lines, answer = told(devices, tmp_path, *REAL)
    assert lines[:2] == ["/dev/ttyS9: a port", "cDAQ1Mod1: NI 9234"]
    parts = {part["part"]: part for part in answer["parts"]}
    assert "127.0.0.1:1: cannot be connected" in parts["load_cell"]["says"]
    assert "/nowhere/ttyUSB1: there is no such port" in parts["stage"]["says"]
    assert parts["accelerometers"]["says"] == "no device is configured (rig.parts)"
    assert not any(part["answers"] for part in answer["parts"])


def test_a_search_asks_the_ports_that_are_not_configured_and_no_others(tmp_path, monkeypatch):
    ports = [{"port": "/nowhere/ttyUSB1", "says": "configured"}, {"port": "/nowhere/ttyS9", "says": "another"}]
    monkeypatch.setattr("mesotap.commands.devices._serial_ports", lambda: ports)
    monkeypatch.setattr("mesotap.commands.devices._recorders", list)
    lines, answer = told(devices, tmp_path, *REAL, search=True)
    assert lines[0] == "/nowhere/ttyUSB1: configured"
    assert lines[1].startswith("/nowhere/ttyS9: another: serial port on /nowhere/ttyS9: there is no such port")
    assert [item["port"] for item in answer["ports"]] == ["/nowhere/ttyUSB1", "/nowhere/ttyS9"]


def test_a_recorder_that_is_not_emulated_is_named():
    with pytest.raises(RigError, match=r"rig.parts.accelerometers: the NI 9234 is not emulated"):
        emulated_rig(small_config("rig.parts.accelerometers={driver: ni-9234}", "rig.wiring.bits=24"))


@pytest.mark.parametrize(("stop_um", "passed"), [(None, None), (140.0, None), (4.0, True)])
def test_a_mechanical_stop_is_asked_for(stop_um, passed):
    """151 um of travel on springs of 269 N/mm in series is 41 N; 4 um are within the limit of 1.1 N."""
    config = small_config(*([] if stop_um is None else [f"rig.limits.mechanical_stop_um={stop_um}"]))
    verdict = next(v for v in self_test(simulated_rig(config), config, touch=False) if v.name == "mechanical stop")
    assert verdict.passed is passed
    assert ("mechanical_stop_um" in verdict.says) is (passed is None)
