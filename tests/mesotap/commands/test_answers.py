"""What a terminal shows while a report is written."""

from __future__ import annotations

import io
import time
from pathlib import Path

import pytest
from rich.console import Console

from mesotap.commands.answers import QUIET_S, telling, writing_report
from mesotap.commands.files import write_session_report
from mesotap.report import report
from tests.mesotap.report.test_report import make_session

LONGEST_S = 120.0  # until a busy machine draws the line


def test_it_says_that_the_report_is_written_while_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session, results = make_session(loads=1)
    shown = io.StringIO()
    console = Console(file=shown, force_terminal=True, width=100)

    def write(*_: object, **__: object) -> Path:
        until = time.monotonic() + LONGEST_S
        while "writing the report ..." not in shown.getvalue() and time.monotonic() < until:
            time.sleep(0.02)
        assert "writing the report ..." in shown.getvalue()
        return tmp_path / "report.html"

    monkeypatch.setattr("mesotap.commands.files.opened_session", lambda *_: session)
    monkeypatch.setattr("mesotap.commands.files.analysed", lambda *_: results)
    monkeypatch.setattr("mesotap.commands.files.provenance", lambda *_: {})
    monkeypatch.setattr(report, "write_report", write)
    write_session_report(tmp_path / "session.h5", None, None, ["mesotap.dwell_s=0"], None, console)
    assert "report.html" in shown.getvalue()


def test_a_terminal_sees_each_step() -> None:
    shown = io.StringIO()
    with writing_report(Console(file=shown, force_terminal=True, width=100)) as tell:
        tell("figure 3 of 9")
        until = time.monotonic() + LONGEST_S
        while "figure 3 of 9" not in shown.getvalue() and time.monotonic() < until:
            time.sleep(0.02)
    assert "writing the report: figure 3 of 9 ..." in shown.getvalue()


def test_a_log_is_told_that_a_report_is_written_and_a_step_now_and_then() -> None:
    shown, now = io.StringIO(), [0.0]
    with writing_report(Console(file=shown, width=100), clock=lambda: now[0]) as tell:
        for number in range(1, 6):
            now[0] += 0.4 * QUIET_S
            tell(f"figure {number} of 5")
    assert shown.getvalue().splitlines() == ["writing the report ...", "writing the report: figure 3 of 5 ..."]


def test_a_log_of_a_diagnosis_is_told_a_step_now_and_then_and_of_a_quick_one_nothing() -> None:
    shown, now = io.StringIO(), [0.0]
    with telling(Console(file=shown, width=100), "diagnosing", lambda: now[0]) as tell:
        for step in ("fitting the linear rig", "screening", "fitting micro slip"):
            now[0] += 0.4 * QUIET_S
            tell(step)
    assert shown.getvalue().splitlines() == ["diagnosing: fitting micro slip ..."]
