"""The log beside a session, and what it counts."""

from __future__ import annotations

import io
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from daq.journal import SessionFolder
from daq.session_file import read_session
from mesotap.commands import session
from mesotap.operator.people import at_terminal
from mesotap.session import session_log as module
from mesotap.session.bench import emulated_rig
from mesotap.session.session_log import LOG_FILE, session_log
from rig.hardware_log import HardwareLog, Repetition, added, repeated
from sim_backend.emulators.disturbance import DisturbedWire, foreign_line
from tests.mesotap.benches import header_of, small_config

ROOT = Path(__file__).parents[3]
LINE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z (DEBUG|INFO|WARNING|ERROR) mesotap(\.\w+)* .+")


def lines(folder: Path) -> list[str]:
    return (folder / LOG_FILE).read_text(encoding="utf-8").splitlines()


def test_a_record_is_one_line_with_time_level_and_logger_and_nothing_a_terminal_would_act_on(tmp_path: Path) -> None:
    with session_log(tmp_path):
        logging.getLogger("mesotap.rig.stage").warning("two\nlines and \x1b[2J a \x07 bell")
    logged = lines(tmp_path)
    assert all(LINE.fullmatch(line) for line in logged)
    assert logged[1].endswith("WARNING mesotap.rig.stage two lines and \\x1b[2J a \\x07 bell")


def test_the_log_of_a_session_goes_on_in_the_same_file(tmp_path: Path) -> None:
    for _ in range(2):
        with session_log(tmp_path):
            pass
    assert sum("works on" in line for line in lines(tmp_path)) == 2


def test_what_ended_a_session_stands_in_the_log(tmp_path: Path) -> None:
    error = ValueError("the cable is out")
    error.add_note("the surfaces are apart")
    with pytest.raises(ValueError, match="cable"), session_log(tmp_path):
        raise error
    assert lines(tmp_path)[-1].endswith("ERROR mesotap.session ended: the cable is out; the surfaces are apart")


def test_the_log_is_of_bounded_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LARGEST_FILE", 20_000)
    with session_log(tmp_path):
        for number in range(1000):
            logging.getLogger("mesotap.rig").warning("%d %s", number, "x" * 10_000)
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == ["session.log", "session.log.1", "session.log.2"]
    assert sum(file.stat().st_size for file in files) < 3 * 20_000


@pytest.mark.parametrize("what", ["a folder", "a link", "a FIFO", "nowhere"])
def test_a_log_that_cannot_be_written_ends_nothing(tmp_path: Path, what: str) -> None:
    folder = tmp_path / "run"
    if what != "nowhere":
        folder.mkdir()
    if what == "a folder":
        (folder / LOG_FILE).mkdir()
    if what == "a link":
        (tmp_path / "other").write_text("")
        (folder / LOG_FILE).symlink_to(tmp_path / "other")
    if what == "a FIFO":
        os.mkfifo(folder / LOG_FILE)
    with session_log(folder) as counts:
        repeated(logging.getLogger("mesotap.rig.stage"), "stage", "a question was asked again")
    assert counts.account()[0].count == 1
    if what == "a link":
        assert (tmp_path / "other").read_text() == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_ends_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    monkeypatch.setattr(module, "open_plain", lambda path, flags: os.dup(full))
    with session_log(tmp_path):
        for _ in range(100):
            logging.getLogger("mesotap.rig").warning("x" * 1000)
    os.close(full)


def test_no_handler_stays_and_none_is_ever_on_the_root_logger(tmp_path: Path) -> None:
    before = list(logging.getLogger("mesotap").handlers)
    with session_log(tmp_path):
        assert logging.getLogger().handlers == [
            h for h in logging.getLogger().handlers if type(h).__module__.startswith("_pytest")
        ]
    assert logging.getLogger("mesotap").handlers == before


def test_a_warning_that_nobody_listens_to_is_not_on_the_terminal() -> None:
    code = "import logging, analysis, rig.drivers.newport as n\n"
    code += "from rig.hardware_log import repeated\nrepeated(n.LOG, 'stage', 'a question was asked again')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_the_accounts_of_several_runs_add_up() -> None:
    first = (Repetition("stage", "asked again", 2, "2026-01-01T00:00:01Z", "2026-01-01T00:00:05Z"),)
    second = (
        Repetition("stage", "asked again", 3, "2026-01-02T00:00:00Z", "2026-01-02T00:00:09Z"),
        Repetition("amplifier", "asked again", 1, "2026-01-02T00:00:01Z", "2026-01-02T00:00:01Z"),
    )
    assert added(first, second) == (
        Repetition("stage", "asked again", 5, "2026-01-01T00:00:01Z", "2026-01-02T00:00:09Z"),
        Repetition("amplifier", "asked again", 1, "2026-01-02T00:00:01Z", "2026-01-02T00:00:01Z"),
    )


def test_only_repetitions_are_counted() -> None:
    counts, logger = HardwareLog(), logging.getLogger("mesotap.rig.test")
    logger.addHandler(counts)
    try:
        logger.warning("something else")
        for detail in ("TP", "TS"):
            repeated(logger, "stage", "a question was asked again", detail)
    finally:
        logger.removeHandler(counts)
    (entry,) = counts.account()
    assert (entry.device, entry.what, entry.count) == ("stage", "a question was asked again", 2)
    assert entry.first <= entry.last


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_report", lambda *arguments: None)
    monkeypatch.setattr(session, "results_json", lambda results: {})


def carried_out(folder: Path, wire: DisturbedWire | None = None) -> None:
    config = small_config("mesotap.diagnose=false")
    rig = emulated_rig(config, stage_wire=wire)
    console = Console(file=io.StringIO())
    if (folder / "session.json").exists():
        opened = SessionFolder.open(folder)
    else:
        opened = SessionFolder.create(folder, header_of(config))
    with opened:
        session._carry_out(opened, config, rig, at_terminal(console), None)


@pytest.mark.usefixtures("quick")
def test_what_a_session_had_to_repeat_is_in_log_journal_and_file(tmp_path: Path) -> None:
    wire = DisturbedWire(foreign_line, 1)
    for fault in ("lost", "lost", "foreign"):
        wire.inject(fault)
    carried_out(tmp_path / "run", wire)
    kept = read_session(tmp_path / "run" / "session.h5").hardware
    assert kept is not None
    counts = {entry.what: entry.count for entry in kept}
    assert counts["a question was asked again"] == 2
    assert counts["a line was foreign or damaged"] == 1
    with SessionFolder.open(tmp_path / "run") as folder:
        (event,) = [e for e in folder.events() if e["event"] == "hardware"]
    assert {e["what"]: e["count"] for e in event["repeated"]} == counts
    warnings = [line for line in lines(tmp_path / "run") if " WARNING mesotap.rig.stage micrometer stage: " in line]
    assert len(warnings) == sum(counts.values())


@pytest.mark.usefixtures("quick")
def test_a_session_in_which_nothing_was_repeated_says_so(tmp_path: Path) -> None:
    carried_out(tmp_path / "run")
    assert read_session(tmp_path / "run" / "session.h5").hardware == ()
    assert any("INFO mesotap.session approaching: " in line for line in lines(tmp_path / "run"))
    assert any(' INFO mesotap.journal shot {"number": 0, ' in line for line in lines(tmp_path / "run"))
    assert not any(" WARNING " in line for line in lines(tmp_path / "run"))


def test_a_recorder_that_is_started_again_is_counted() -> None:
    config = small_config()
    rig = emulated_rig(config)
    rig.open()
    rig.accelerometers.start()
    rig.accelerometers.read_block()
    counts = HardwareLog()
    logging.getLogger("mesotap").addHandler(counts)
    try:
        rig.recorder.inject("stall")
        rig.accelerometers.read_block()
    finally:
        logging.getLogger("mesotap").removeHandler(counts)
        rig.close()
    (entry,) = counts.account()
    assert (entry.what, entry.count) == ("the recording was started again", 1)
    assert "1608FS" in entry.device
