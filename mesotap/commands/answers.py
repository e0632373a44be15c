"""What the commands that answer something have in common."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn
from rich.table import Table

from analysis.results import SessionResults
from analysis.session import analyse_session
from daq.durable import write_whole
from daq.errors import RecordingError
from daq.records import Session
from daq.regular import read_head
from daq.session_file import read_session
from mesotap.config import Config
from mesotap.rounding import with_uncertainty
from mesotap.terminal import escape


def write_json(path: Path | None, answer: Any) -> None:
    """Write an answer for programs to ``path`` (``-``: standard output), whole or not at all; None writes nothing."""
    if path is None:
        return
    text = json.dumps(answer, indent=1, allow_nan=False) + "\n"
    if str(path) != "-" and path.is_file() and read_head(path, 1) not in (b"", b"{", b"["):
        raise RecordingError(f"{path}: exists already and is no JSON; it is left as it is, name another file")
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


def refuse_to_overwrite(path: Path) -> None:
    """Raise where a file is there that cannot be made again: anything but one imported or simulated ring-down."""
    if not path.exists() or (path.is_file() and path.stat().st_size == 0):
        return
    try:
        there = read_session(path)
    except RecordingError:
        there = None
    if there is None or there.pre is not None or len(there.shots) > 1:
        raise RecordingError(f"{path}: exists already and is left as it is; name another file")


def show_session(results: SessionResults, console: Console) -> None:
    """Print the table of a session's loads, and what there is to say of them."""
    shown = Table(title=f"{escape(results.source)}: {results.method}, 95 % intervals")
    for heading in ("load, mN", "impacts", "f1, Hz", "f2, Hz", "zeta1, %", "zeta2, %", "k_c, MN/m", "c_c, N s/m"):
        shown.add_column(heading, justify="right")
    for load in results.loads:
        shown.add_row(
            with_uncertainty(load.load_mn),
            str(load.impacts_used),
            with_uncertainty(load.f1_hz),
            with_uncertainty(load.f2_hz),
            with_uncertainty(load.zeta1, 100),
            with_uncertainty(load.zeta2, 100),
            with_uncertainty(load.contact_stiffness_n_per_m, 1e-6),
            with_uncertainty(load.contact_damping_n_s_per_m),
        )
    console.print(shown)
    for note in results.notes:
        console.print(f"- {escape(note)}", highlight=False)
    for load in results.loads:
        for note in load.notes:
            console.print(f"- load {load.target_load_mn:.0f} mN: {escape(note)}", highlight=False)
    if results.calibration is not None:
        console.print(escape(results.calibration.statement), highlight=False)
