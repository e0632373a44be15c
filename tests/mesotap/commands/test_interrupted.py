"""What is said of a session that was interrupted: how it goes on, where it can."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from daq.journal import HEADER
from mesotap.commands import session, theory
from mesotap.session.order import RigChoice
from rig.errors import SessionAborted


def test_an_interrupt_at_any_time_of_a_session_says_how_it_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(config: object, choice: object, path: Path, *others: object) -> None:
        path.mkdir()
        (path / HEADER).write_text("{}")
        raise KeyboardInterrupt

    monkeypatch.setattr(session, "begin", interrupted)
    with pytest.raises(SessionAborted) as caught:
        session.run(None, (), RigChoice(simulate=True), tmp_path / "s", None, Console(file=io.StringIO()))
    assert caught.value.__notes__ == ["'mesotap resume' goes on"]


def test_an_interrupt_before_there_is_a_session_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*anything: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(session, "begin", interrupted)
    with pytest.raises(KeyboardInterrupt):
        session.run(None, (), RigChoice(simulate=True), tmp_path / "s", None, Console(file=io.StringIO()))


def test_figures_offer_no_session_to_go_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def aborted(*anything: object) -> None:
        raise SessionAborted("session ended by Ctrl-C")

    monkeypatch.setattr(session, "run", aborted)
    with pytest.raises(KeyboardInterrupt):
        theory.paper_figures(tmp_path, 1, None, Console(file=io.StringIO()))
