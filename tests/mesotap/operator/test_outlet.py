"""Output that nobody reads: a session neither waits for it nor ends with it."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from mesotap.operator import outlet as outlets
from mesotap.operator.outlet import Outlet, unhurried

ROOT = Path(__file__).parents[3]
SHORT = ("mesotap.load_plan_mn=[300]", "mesotap.impacts_per_load=2", "mesotap.dwell_s=1")
PATIENCE_S = 60.0  # what waits for a reader that never reads never comes back


def test_text_comes_out_as_it_was_written():
    reading, writing = os.pipe()
    outlet = Outlet(writing, "utf-8")
    for i in range(200):
        outlet.write(f"line {i} \N{GREEK SMALL LETTER MU}\n")
    outlet.end()
    os.close(writing)
    with os.fdopen(reading, encoding="utf-8") as file:
        assert file.read().splitlines() == [f"line {i} \N{GREEK SMALL LETTER MU}" for i in range(200)]


def comes_back(what: Callable[[], None]) -> bool:
    thread = threading.Thread(target=what, daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    return not thread.is_alive()


def test_nobody_waits_for_a_reader_that_stands_still(monkeypatch):
    monkeypatch.setattr(outlets, "LAST_WAIT_S", 0.05)
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 4096)
    outlet = Outlet(writing, "utf-8")

    def write() -> None:
        for _ in range(1000):
            outlet.write("x" * 1000)
            outlet.flush()

    assert comes_back(write)
    assert comes_back(outlet.end)
    os.close(reading)


def test_a_reader_that_has_gone_is_no_error():
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as file:
        console = Console(file=file)
        with unhurried(console):
            for _ in range(100):
                console.print("nobody is there")


def test_a_console_without_a_descriptor_stays_as_it_is(capsys):
    console = Console(file=sys.stdout)
    before = console.file
    with unhurried(console):
        assert console.file is before


def session(tmp_path: Path, **streams) -> subprocess.Popen[bytes]:
    settings = [part for change in SHORT for part in ("--set", change)]
    command = [sys.executable, "-m", "mesotap", "run", "--simulate", "-o", str(tmp_path / "s"), *settings]
    return subprocess.Popen(command, cwd=ROOT, **streams)


@pytest.mark.long
def test_a_session_whose_reader_has_gone_comes_to_its_end(tmp_path):
    running = session(tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    running.stdout.close()
    _, told = running.communicate(timeout=120)
    assert b"Traceback" not in told
    entries = [json.loads(line) for line in (tmp_path / "s" / "journal.jsonl").read_text().splitlines()]
    assert entries[-1]["event"] == "filed"
    assert (tmp_path / "s" / "session.h5").exists()


@pytest.mark.long
def test_a_full_output_device_is_a_sentence_and_costs_nothing(tmp_path):
    with Path("/dev/full").open("wb") as full:
        running = session(tmp_path, stdout=full, stderr=subprocess.PIPE)
        _, told = running.communicate(timeout=120)
    assert b"Traceback" not in told
    assert told == b"mesotap: the output cannot be written (No space left on device)\n"
    assert running.returncode == 2
    assert (tmp_path / "s" / "session.h5").exists()
