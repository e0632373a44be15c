"""What went over the wires is recorded as it was, and the drivers do the same again when it is played back."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mesotap.commands.wire_options import WireOptions
from mesotap.configuration.config import parse_config
from mesotap.session.bench import emulated_rig
from rig.drivers import wire_record
from rig.drivers.amplifier import DEVICE as AMPLIFIER
from rig.drivers.motor_stage import DEVICE as STAGE
from rig.drivers.settings import AmplifierTcp
from rig.drivers.wire_record import WireFile
from rig.drivers.wire_replay import RecordedFault, WireMismatch, read_recording
from rig.errors import RigError
from sim_backend.emulators.disturbance import DisturbedWire, WireFault, foreign_line, foreign_rtu, foreign_tcp
from tests.mesotap.benches import new_runner, small_config
from tests.wires.exchanges import exchanges
from tests.wires.replaying import Replayed

TCP = "rig.parts.load_cell={driver: modbus-tcp, preset: seneca-ze-sg3, host: 192.168.1.5}"

ROOT = Path(__file__).parents[3]
WIRES = sorted((ROOT / "tests" / "wires").glob("*.jsonl"))
MOVES_UM = (5.0, 2.5, 0.3, -4.0)


def entries(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def started(path: Path, stage_wire: DisturbedWire | None = None, **options: bool) -> list[object]:
    """Record the start of a session on emulated devices: connecting, a few moves with the gauge read after each."""
    config = parse_config("")
    with WireOptions(path, **options).begun(config, "run") as file:
        rig = emulated_rig(config, seed=4, wire_file=file, stage_wire=stage_wire)
        said: list[object] = list(rig.open()[:2])
        for move_um in MOVES_UM:
            said.append(rig.stage.move_by(move_um).position_um)
            said.append(rig.load_cell.read().voltage_mv)
        rig.stage.lock()
        rig.accelerometers.start()
        for _ in range(200):
            rig.accelerometers.read_block()
        rig.close()
    return said


def started_again(path: Path) -> list[object]:
    rig = Replayed(path)
    assert rig.stage is not None
    assert rig.load_cell is not None
    said: list[object] = [rig.stage.connect(), rig.load_cell.connect()]
    for move_um in MOVES_UM:
        said.append(rig.stage.move_by(move_um).position_um)
        said.append(rig.load_cell.read().voltage_mv)
    rig.stage.lock()
    rig.stage.close()
    rig.load_cell.close()
    assert [wire.left() for wire in rig.wires.values()] == [(), ()]
    return said


def test_the_start_of_a_session_is_played_back_to_the_last_byte(tmp_path: Path) -> None:
    said = started(tmp_path / "wire.jsonl")
    assert started_again(tmp_path / "wire.jsonl") == said


def test_faults_on_the_wire_are_played_back_too(tmp_path: Path) -> None:
    wire = DisturbedWire(foreign_line, 1)
    for fault in ("lost", "foreign", "late", "truncated", "duplicated", "flipped reply", "flipped request"):
        wire.inject(fault)
    said = started(tmp_path / "wire.jsonl", wire)
    assert started_again(tmp_path / "wire.jsonl") == said


def test_a_driver_that_does_something_else_is_told_the_line(tmp_path: Path) -> None:
    started(tmp_path / "wire.jsonl")
    rig = Replayed(tmp_path / "wire.jsonl")
    assert rig.stage is not None
    rig.stage.connect()
    before = rig.wires[STAGE].left()
    with pytest.raises(
        WireMismatch, match=r"the driver would write b'1PA\S+', the recording has write b'1PA"
    ) as parted:
        rig.stage.move_by(MOVES_UM[0] + 1)
    line = int(str(parted.value).split(", line ")[1].split(":")[0])
    assert entries(tmp_path / "wire.jsonl")[line - 1]["hex"].startswith(b"1PA".hex())
    assert before[0].line < line


def test_a_driver_that_goes_on_past_the_end_is_told(tmp_path: Path) -> None:
    path = tmp_path / "wire.jsonl"
    started(path)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:4]))
    rig = Replayed(path)
    assert rig.stage is not None
    with pytest.raises(WireMismatch, match="the recording is at its end"):
        rig.stage.connect()


def test_the_first_line_says_what_it_is(tmp_path: Path) -> None:
    started(tmp_path / "wire.jsonl")
    header = entries(tmp_path / "wire.jsonl")[0]
    assert (header["format"], header["format_version"], header["command"]) == ("mesotap-wire", 1, "run")
    assert {"software", "python", "created", "parts"} <= set(header)


def test_each_act_has_its_time_device_and_port(tmp_path: Path) -> None:
    started(tmp_path / "wire.jsonl")
    acts = entries(tmp_path / "wire.jsonl")[1:]
    assert {act["device"] for act in acts} == {STAGE, AMPLIFIER, "recorder"}
    assert all(act["port"] and act["t"] >= 0 for act in acts)
    times = [act["t"] for act in acts]
    assert times == sorted(times)


def test_samples_beyond_the_first_are_summarised_and_kept_on_request(tmp_path: Path) -> None:
    started(tmp_path / "short.jsonl")
    started(tmp_path / "all.jsonl", all_samples=True)
    short, whole = (
        [e for e in entries(tmp_path / name)[1:] if e["act"] == "bulk_in"] for name in ("short.jsonl", "all.jsonl")
    )
    assert len(short) == len(whole) == 200
    assert "hex" in short[0]
    assert set(short[-1]) >= {"length", "sha256"}
    assert "hex" not in short[-1]
    assert all("hex" in act for act in whole)
    assert short[-1]["length"] == len(whole[-1]["hex"]) // 2


def test_usb_control_transfers_are_recorded_with_their_setup(tmp_path: Path) -> None:
    started(tmp_path / "wire.jsonl")
    controls = [e for e in entries(tmp_path / "wire.jsonl")[1:] if e["act"].startswith("control")]
    assert {e["act"] for e in controls} == {"control_in", "control_out"}
    serial_number = next(e for e in controls if e["setup"][1] == 0x48)
    assert serial_number["setup"][0] == 0xC0
    assert len(bytes.fromhex(serial_number["hex"])) == 8


def test_a_recording_is_not_written_over_another_file(tmp_path: Path) -> None:
    (tmp_path / "wire.jsonl").write_text("precious")
    with pytest.raises(RigError, match="exists already and is left as it is"):
        WireFile(tmp_path / "wire.jsonl", {})
    assert (tmp_path / "wire.jsonl").read_text() == "precious"


def test_a_recording_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire_record, "LARGEST_RECORDING", 5000)
    file = WireFile(tmp_path / "wire.jsonl", {})
    for _ in range(1000):
        file.note("stage", "port", "write", b"1TS\r\n")
    file.close()
    assert (tmp_path / "wire.jsonl").stat().st_size < 5100
    assert entries(tmp_path / "wire.jsonl")[-1] == {"act": "full"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_ends_the_recording_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = WireFile(tmp_path / "wire.jsonl", {})
    full = os.open("/dev/full", os.O_WRONLY)
    monkeypatch.setattr(file, "_descriptor", full)
    for _ in range(3):
        file.note("stage", "port", "write", b"1TS\r\n")
    file.close()


WORKER = """
import sys
from pathlib import Path
from rig.drivers.settings import AmplifierTcp
from rig.drivers.wire_record import WireFile
file = WireFile(Path(sys.argv[1]), {})
n = 0
while True:
    file.note("stage", "port", "write", str(n).encode())
    print(n, flush=True)
    n += 1
"""


def test_a_kill_costs_at_most_the_last_line(tmp_path: Path) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", WORKER, str(tmp_path / "wire.jsonl")], stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
    assert child.stdout is not None
    reported = -1
    while reported < 100:
        reported = int(child.stdout.readline())
    child.send_signal(signal.SIGKILL)
    child.communicate()
    acts = read_recording(tmp_path / "wire.jsonl").acts
    assert [act.data for act in acts[: reported + 1]] == [str(n).encode() for n in range(reported + 1)]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is not a recording of a wire"),
        (b'{"format": "photographs"}\n', "is not a recording of a wire"),
        (b'{"format": "mesotap-wire", "format_version": 9}\n', "is of version 9"),
        (b'{"format": "mesotap-wire", "format_version": 1}\nrubbish\n{}\n', "line 2 is damaged"),
        (b'{"format": "mesotap-wire", "format_version": 1}\n{"act": "read", "t": 0}\n', "line 2 is damaged"),
        (
            b'{"format": "mesotap-wire", "format_version": 1}\n'
            b'{"act": "read", "t": 0, "device": "a", "port": "b", "hex": "xy"}\n',
            "line 2 is damaged",
        ),
    ],
)
def test_what_is_no_recording_is_one_sentence(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "wire.jsonl").write_bytes(content)
    with pytest.raises(RigError, match=said):
        read_recording(tmp_path / "wire.jsonl")


@given(st.binary(max_size=300), st.booleans())
def test_any_bytes_are_a_recording_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, rest: bytes, begun: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.jsonl"
    path.write_bytes(b'{"format": "mesotap-wire", "format_version": 1}\n' * begun + rest)
    try:
        read_recording(path)
    except RigError as error:
        assert "\n" not in str(error)


def test_a_last_line_that_was_cut_is_left_out(tmp_path: Path) -> None:
    started(tmp_path / "wire.jsonl")
    whole = (tmp_path / "wire.jsonl").read_bytes()
    (tmp_path / "wire.jsonl").write_bytes(whole[: whole.rindex(b"{") + 9])
    assert read_recording(tmp_path / "wire.jsonl").acts


def test_what_a_port_raised_is_raised_again(tmp_path: Path) -> None:
    wire = DisturbedWire(foreign_line, 1)
    wire.inject("pulled")
    with pytest.raises(RigError, match="the connection is gone"):
        started(tmp_path / "wire.jsonl", wire)
    rig = Replayed(tmp_path / "wire.jsonl")
    with pytest.raises(RecordedFault, match="the connection is gone"):
        rig.wires[STAGE].open()


@pytest.mark.parametrize("path", WIRES, ids=[path.stem for path in WIRES])
def test_the_drivers_do_again_what_was_recorded(path: Path) -> None:
    """Connect to each recorded device; what else was asked is asked again below."""
    said = Replayed(path).connect()
    assert said == read_recording(path).header.get("connected", said)


# --- from the midst of a session --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("part", "round_trip_s"),
    [("", 0.0), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((TCP, 0.0), ("", 0.03)))],
    ids=["RTU", "TCP", "slow"],
)
def test_every_exchange_of_a_session_is_read_again_as_it_was(tmp_path: Path, part: str, round_trip_s: float) -> None:
    """A whole session, on wires that lose, damage and delay: each question is repeated where it was, and read alike."""
    wires = [DisturbedWire(foreign_line, 1), DisturbedWire(foreign_tcp if part else foreign_rtu, 2)]
    config = small_config(*([part] if part else []))
    with WireOptions(tmp_path / "wire.jsonl").begun(config, "run") as file:
        rig = emulated_rig(
            config, seed=4, wire_file=file, stage_wire=wires[0], amplifier_wire=wires[1], round_trip_s=round_trip_s
        )
        asked = count_questions(rig, wires)
        folder, runner = new_runner(tmp_path / "session", config, rig)
        with folder:
            runner.run()
    read = list(exchanges(tmp_path / "wire.jsonl"))
    loads = [e for e in read if e.device == AMPLIFIER and isinstance(e.answer, list)]
    places = [e for e in read if e.device == STAGE and isinstance(e.answer, float) and e.question == "TP"]
    assert len(loads) == len(asked["words"])
    assert [e.answer for e in loads] == asked["words"]
    assert [e.answer for e in places] == asked["places"]
    assert sum(asked["injected"]) > 20


def count_questions(rig, wires) -> dict[str, list]:
    """Note what the drivers got, and have something happen to every fortieth message."""
    asked: dict[str, list] = {"words": [], "places": [], "injected": []}
    device, axis = rig.load_cell._wire, rig.stage._axis
    read, position = device.read, axis.position_mm
    # TCP has check bytes of its own, below what a driver sees
    flipped = [] if isinstance(rig.load_cell._settings, AmplifierTcp) else [WireFault.FLIPPED_REPLY]
    faults = [*flipped, WireFault.LOST, WireFault.TRUNCATED, WireFault.LATE, WireFault.DUPLICATED]

    def noted(keep: str, ask):
        def noting(*question):
            number = len(asked["words"]) + len(asked["places"])
            if number % 40 == 39:
                wires[keep == "words"].inject(faults[number // 40 % len(faults)])
                asked["injected"].append(1)
            answer = ask(*question)
            asked[keep].append(answer)
            return answer

        return noting

    device.read, axis.position_mm = noted("words", read), noted("places", position)
    return asked


@pytest.mark.parametrize("path", WIRES, ids=[path.stem for path in WIRES])
def test_every_exchange_of_a_recording_can_be_asked_again(path: Path) -> None:
    assert list(exchanges(path))


def test_a_driver_that_would_ask_otherwise_is_named_with_the_line(tmp_path: Path) -> None:
    started(tmp_path / "wire.jsonl")
    lines = (tmp_path / "wire.jsonl").read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if json.loads(line).get("act") == "read" and i > 40)
    entry = {**json.loads(lines[at]), "hex": "00"}
    (tmp_path / "wire.jsonl").write_text("\n".join([*lines[:at], json.dumps(entry), *lines[at + 1 :]]) + "\n")
    with pytest.raises(WireMismatch, match="line "):
        list(exchanges(tmp_path / "wire.jsonl"))


# --- the recorder -------------------------------------------------------------------------------------------------


def test_the_recorder_is_played_back_transfer_by_transfer(tmp_path: Path) -> None:
    config = parse_config("")
    with WireOptions(tmp_path / "wire.jsonl").begun(config, "devices") as file:
        rig = emulated_rig(config, seed=4, wire_file=file)
        said = rig.open()[2]
        rig.accelerometers.start()
        blocks = [rig.accelerometers.read_block().acceleration for _ in range(20)]
        rig.accelerometers.stop()
    again = Replayed(tmp_path / "wire.jsonl")
    assert again.recorder is not None
    assert again.recorder.connect() == said
    again.recorder.start()
    for block in blocks:
        assert np.array_equal(again.recorder.read_block().acceleration, block)
    again.recorder.stop()
    assert not again.usb.left


@pytest.mark.parametrize(("fault", "sentence"), [("stall", "it refused"), ("unplug", "gone"), ("timeout", "did not")])
def test_what_the_bus_raised_is_raised_again(tmp_path: Path, fault: str, sentence: str) -> None:
    with WireOptions(tmp_path / "wire.jsonl").begun(parse_config(""), "devices") as file:
        rig = emulated_rig(parse_config(""), seed=4, wire_file=file)
        rig.recorder.inject(fault)
        try:
            rig.open()
            told = ""
        except RigError as error:
            told = str(error)
    again = Replayed(tmp_path / "wire.jsonl")
    assert again.recorder is not None
    try:
        again.recorder.connect()
        told_again = ""
    except RigError as error:
        told_again = str(error)
    assert told_again == told
    if told:
        assert sentence in told
