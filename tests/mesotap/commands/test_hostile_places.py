"""Places, links, states and texts that somebody chose to lead a command elsewhere: each is refused in one sentence."""

from __future__ import annotations

import io
import json
import os
import pty
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from daq.errors import RecordingError, UnwrittenError
from daq.journal import SessionFolder
from daq.journal_file import append_after_death
from mesotap.answers.adoption import AdoptedModel, read_diagnosis, with_model
from mesotap.answers.results_files import _cell
from mesotap.commands import outputs, recordings, recover
from mesotap.commands import session as commands
from mesotap.commands.outputs import make_ready, write_json
from mesotap.configuration.config import Config, ConfigError, effective_text
from mesotap.report.report import figure_folder, write_report
from mesotap.session import emulated_devices
from mesotap.session.bench import simulated_rig
from mesotap.session.emulated_devices import refuse_foreign_devices
from mesotap.session.recovery import recover as recovered
from rig import RigError
from sim_backend.emulators.bench_process import CONTROL, Devices
from tests.mesotap.benches import small_config


def silent() -> Console:
    return Console(file=io.StringIO(), width=200)


@pytest.mark.parametrize("path", ["", "/", ".", ".."])
def test_an_answer_goes_into_no_folder(path: str) -> None:
    with pytest.raises(UnwrittenError, match="cannot be written: it is a folder; name a file"):
        write_json(Path(path), {})


def test_where_an_answer_cannot_go_is_told_before_it_is_computed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    make_ready(tmp_path / "answer.json", tmp_path / "new" / "page")
    assert (tmp_path / "new" / "page").is_dir()
    with pytest.raises(UnwrittenError, match="the folder does not exist"):
        make_ready(tmp_path / "nowhere" / "answer.json", None)
    with pytest.raises(UnwrittenError, match="a part of the path is a file"):
        make_ready(None, tmp_path / "file" / "page")


def test_the_root_gives_no_file_its_name() -> None:
    with pytest.raises(RecordingError, match="/: has no name to call the session file after"):
        recover.recover_folder(Path("/"), None, None, silent())
    for path in ("/", ""):
        with pytest.raises(RecordingError, match="is a folder, not a recording"):
            recordings.import_file(Path(path), None, None, (), None, silent())


def test_a_pipe_is_written_to_and_stays(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(UnwrittenError, match="nobody reads from this pipe"):
        write_json(pipe, {"a": 1})
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    for _ in range(12000):
        try:
            write_json(pipe, {"a": 1})
            break
        except UnwrittenError:  # the reader is not there yet
            time.sleep(0.01)
    reader.join()
    assert json.loads(read[0]) == {"a": 1}
    assert pipe.is_fifo()


def test_a_device_is_written_to_and_stays() -> None:
    ours, theirs = pty.openpty()
    try:
        place = Path(os.ttyname(theirs))
        write_json(place, {"a": 1})
        assert place.is_char_device()
        assert json.loads(os.read(ours, 1000)) == {"a": 1}
    finally:
        os.close(ours)
        os.close(theirs)


def test_what_stands_in_for_standard_output_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outputs, "DEVICE_FOLDERS", (tmp_path / "dev",))
    (tmp_path / "dev").mkdir()
    (tmp_path / "out").touch()
    (tmp_path / "dev/stdout").symlink_to(tmp_path / "out")
    with pytest.raises(UnwrittenError, match="name another, or - for standard output"):
        write_json(tmp_path / "dev/stdout", {})
    assert (tmp_path / "dev/stdout").is_symlink()


@pytest.mark.parametrize("text", ["=1", "\n=HYPERLINK()", " \n +1", "\r\n@a", "\t=1", "\uff1d1", "\u2028=1"])
def test_no_cell_begins_as_a_formula(text: str) -> None:
    cell = str(_cell(text))
    assert cell.startswith(("'", "\\"))


def journal(folder: Path, change: Callable[[list[dict[str, Any]]], Any]) -> None:
    file = folder / "journal.jsonl"
    entries = [json.loads(line) for line in file.read_text().splitlines()]
    change(entries)
    file.write_text("".join(json.dumps(entry) + "\n" for entry in entries))


@pytest.mark.parametrize("last", [False, True])
def test_a_key_twice_in_the_journal_is_damage(folder: Path, last: bool) -> None:
    file = folder / "journal.jsonl"
    lines = file.read_text().splitlines()
    number = len(lines) if last else 7
    lines[number - 1] = lines[number - 1].replace('"event": ', '"event": "shot", "event": ', 1)
    content = "\n".join(lines) + "\n"
    file.write_text(content)
    with pytest.raises(RecordingError, match=f"journal.jsonl: line {number} is damaged: 'event' is given twice; 'meso"):
        SessionFolder.open(folder)
    assert f"journal.jsonl, line {number}: 'event' is given twice" in recovered(folder).losses
    assert append_after_death(folder, {"event": "safe"})
    assert file.read_text() == content + '{"event": "safe"}\n'


def test_a_key_twice_in_the_header_is_damage(folder: Path) -> None:
    file = folder / "session.json"
    file.write_text(file.read_text().replace('"seed": ', '"seed": 7, "seed": ', 1))
    with pytest.raises(RecordingError, match=r"session\.json: is damaged: 'seed' is given twice"):
        SessionFolder.open(folder)


def test_a_key_twice_in_a_diagnosis_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "d.json"
    file.write_text('{"format": "mesotap-diagnosis", "version": 1, "mechanisms": [], "mechanisms": []}')
    with pytest.raises(RecordingError, match=r"d\.json: 'mechanisms' is given twice; it is ambiguous which one counts"):
        read_diagnosis(file)


def test_a_constant_that_is_none_is_named_when_it_is_adopted() -> None:
    model = AdoptedModel("d.json", {}, (), {"m1": -0.1, "m2": 0.1, "k1": 5e5, "k2": 5e5})
    with pytest.raises(ConfigError, match=r"d.json: rig\.masses\.m1_kg is -0\.1: input should be greater than 0"):
        with_model(Config(), model)


# --- links ------------------------------------------------------------------------------------------------------


def linked(place: Path) -> None:
    elsewhere = place.with_name(f"{place.name} elsewhere")
    place.rename(elsewhere)
    place.symlink_to(elsewhere)


@pytest.mark.parametrize("name", ["shots", "shots/00001.h5", "journal.jsonl"])
def test_a_link_in_a_session_folder_is_not_followed(folder: Path, name: str) -> None:
    linked(folder / name)
    with pytest.raises(RecordingError, match=f"{name}: is a link to another place, which is not followed"):
        recordings.info(folder, None, silent())
    with (
        pytest.raises(RecordingError, match=f"{name}: is a link to another place, which is not followed"),
        SessionFolder.open(folder) as opened,
    ):
        opened.read_impact(1)


def test_no_session_is_begun_behind_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "run").mkdir()
    (tmp_path / "run/shots").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RecordingError, match="shots: is a link to another place"):
        SessionFolder.create(tmp_path / "run", {})


def test_no_figure_is_drawn_behind_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "figures").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UnwrittenError, match="figures: cannot be written: it is a link to another place; remove it"):
        write_report(tmp_path, None, None, ())  # type: ignore[arg-type]
    with pytest.raises(UnwrittenError, match="it is a link to another place"):
        figure_folder(tmp_path)


# --- the kept state of a simulated rig ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("part", "item", "value", "said"),
    [
        ("stage", "knob_um", "x", "stage.knob_um is 'x': input should be a valid number"),
        ("stage", "knob_um", float("inf"), "stage.knob_um is inf, which nothing in a rig is"),
        ("stage", "knob_um", 1e308, r"stage.knob_um is 1e\+308, which"),
        ("stage", "locked", "yes", "stage.locked is 'yes': input should be a valid boolean"),
        ("", "time_s", 1e300, r"time_s is 1e\+300, which"),
        ("", "time_s", "t", "time_s is 't': input should be a valid number"),
        ("", "peak_true_load_mn", "x", "peak_true_load_mn is 'x'"),
        ("load_cell", "last_voltage_mv", 1e308, r"load_cell.last_voltage_mv is 1e\+308"),
        ("load_cell", "last_voltage_mv", 1e12, r"load_cell.last_voltage_mv is 1000000000000\.0: input should be less"),
        ("load_cell", "fault", "boom", "load_cell.fault.* is 'boom'"),
        ("weights", "nominal_mn", 10**400, r"weights.nominal_mn is 10{30,40}\.\.\., which"),
    ],
)
def test_a_state_that_no_rig_can_have_been_in_is_refused(part: str, item: str, value: Any, said: str) -> None:
    rig = simulated_rig(small_config(), seed=1)
    state = rig.checkpoint()
    (state[part] if part else state)[item] = value
    with pytest.raises(ValueError, match=said) as refusal:
        rig.restore(state)
    assert len(str(refusal.value)) < 150


def test_a_state_that_a_rig_was_in_is_taken_up() -> None:
    rig = simulated_rig(small_config(), seed=1)
    rig.load_cell.fault = ("offset", 3.0)
    rig.stage.move_by(3.0)
    state = json.loads(json.dumps(rig.checkpoint()))
    other = simulated_rig(small_config(), seed=1)
    other.restore(state)
    assert json.loads(json.dumps(other.checkpoint())) == state


def test_a_seed_of_hundreds_of_digits_is_shown_short(folder: Path) -> None:
    rig = simulated_rig(small_config(), seed=1)
    with pytest.raises(RigError) as refusal:
        rig.restore({**rig.checkpoint(), "seed": 10**400})
    assert len(str(refusal.value)) < 200
    header = json.loads((folder / "session.json").read_text())
    (folder / "session.json").write_text(json.dumps({**header, "seed": 10**400}))
    with pytest.raises(RecordingError, match=r"session.json: is damaged: seed: .{,70}; 'mesotap recover"):
        commands.resume(folder, None, silent())


def test_no_session_is_begun_with_a_seed_that_none_can_be_resumed_with(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="this session could not be resumed"):
        commands.run(None, (), commands.RigChoice(simulate=True, seed=10**400), tmp_path / "run", None, silent())
    assert list(tmp_path.iterdir()) == []


# --- emulated devices -------------------------------------------------------------------------------------------


@pytest.fixture
def place() -> Any:
    with tempfile.TemporaryDirectory() as made:
        yield Path(made)


def test_only_devices_that_are_there_and_ours_are_taken_up(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    header = Path("session.json")
    for nowhere in (place / "x", Path("['x']"), Path("a\0b"), place):
        with pytest.raises(RecordingError, match=r"emulated devices should run in .* none any more; begin"):
            refuse_foreign_devices(nowhere, header)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(place / CONTROL))
        with pytest.raises(RecordingError, match="they answer no more"):
            refuse_foreign_devices(place, header)
        place.chmod(0o777)
        with pytest.raises(RecordingError, match="was not started by you"):
            refuse_foreign_devices(place, header)
        place.chmod(0o700)
        monkeypatch.setattr(emulated_devices.os, "getuid", lambda: 12345)
        with pytest.raises(RecordingError, match="was not started by you"):
            refuse_foreign_devices(place, header)
    assert [entry.name for entry in place.iterdir()] == [CONTROL]


@pytest.mark.parametrize(
    ("devices", "said"), [(["x"], "is damaged: devices: Input"), ("/tmp/none-of-ours", "none any")]
)
def test_resume_makes_no_folder_that_a_header_names(folder: Path, devices: Any, said: str, monkeypatch: Any) -> None:
    monkeypatch.chdir(folder.parent)
    header = json.loads((folder / "session.json").read_text())
    chosen = {**header, "emulated": True, "simulated": True, "realtime": True, "devices": devices}
    (folder / "session.json").write_text(json.dumps(chosen))
    with pytest.raises(RecordingError, match=said):
        commands.resume(folder, None, silent())
    assert [entry.name for entry in folder.parent.iterdir()] == ["run"]
    assert not Path("/tmp/none-of-ours").exists()


def test_devices_that_end_at_once_are_told_at_once(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[tuple[Any, Any]] = []
    start = subprocess.Popen

    def begin(command: list[str], **options: Any) -> Any:
        started.append((start([sys.executable, "-c", "raise SystemExit(3)"], **options), options))
        return started[-1][0]

    monkeypatch.setattr(emulated_devices.subprocess, "Popen", begin)
    with pytest.raises(RigError, match=r"they ended at once \(exit code 3\)"):
        emulated_devices.separate_rig(small_config(), None, 1, place)  # type: ignore[arg-type]
    process, options = started[0]
    assert process.returncode == 3
    assert options["stdout"] == options["stderr"] == subprocess.DEVNULL


def test_devices_in_a_folder_whose_name_is_longer_than_a_socket_takes(tmp_path: Path) -> None:
    folder = tmp_path / ("long" * 30)
    folder.mkdir()
    (folder / "config.yaml").write_text(effective_text(small_config()), encoding="utf-8")
    process = subprocess.Popen([sys.executable, "-m", "mesotap.session.emulated_devices", str(folder), "1"])
    try:
        while not (folder / CONTROL).exists():
            assert process.poll() is None
            time.sleep(0.02)
        devices = Devices(folder)
        assert devices.call("state")["load_mn"] == 0.0
        devices.call("end")
        devices.close()
        assert process.wait(60) == 0
        assert not (folder / CONTROL).exists()
    finally:
        process.kill()
        process.wait()


def test_a_run_that_is_refused_leaves_no_devices_behind(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = []

    class Separate(emulated_devices.SeparateRig):
        def __init__(self) -> None:
            pass

        def end_devices(self) -> None:
            ended.append(True)

    monkeypatch.setattr(commands, "_rig_of", lambda *arguments: Separate())
    with pytest.raises(RecordingError, match="holds a session already"):
        commands.run(None, (), commands.RigChoice(emulate=True, seed=1, realtime=True), folder, None, silent())
    assert ended == [True]
