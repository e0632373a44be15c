"""What a terminal shows while a report is written."""

from __future__ import annotations

import io
import time
from pathlib import Path

import pytest
from rich.console import Console

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
