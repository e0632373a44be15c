"""What the commands that answer something have in common."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn

from analysis.results import SessionResults
from analysis.session import analyse_session
from daq.durable import write_whole
from daq.records import Session
from mesotap.config import Config


def write_json(path: Path | None, answer: Any) -> None:
    """Write an answer for programs to ``path`` (``-``: standard output), whole or not at all; None writes nothing."""
    if path is None:
        return
    text = json.dumps(answer, indent=1, allow_nan=False) + "\n"
    if str(path) == "-":
        sys.stdout.write(text)
        return
    write_whole(path, text.encode())


def analysed(session: Session, config: Config, console: Console) -> SessionResults:
    """Analyse a session under a progress line."""
    with Progress(SpinnerColumn(), TextColumn("{task.description}"), console=console, transient=True) as shown:
        task = shown.add_task("finding the modes of every impact")
        return analyse_session(
            session,
            config.analysis,
            config.calibration,
            config.rig.masses,
            config.rig.springs,
            lambda done, total: shown.update(task, description=f"analysed {done} of {total} loads"),
        )
