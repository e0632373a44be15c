"""`mesotap diagnose` and `mesotap mechanisms`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from analysis.mismatch.diagnosis import diagnose_session
from daq.errors import RecordingError
from mesotap.diagnosis_files import diagnosis_answer, print_diagnosis
from sim_backend.mechanisms.mechanism import mechanisms


def diagnose(file: Path, json: Path | None, without: Sequence[str], console: Console) -> None:
    """Diagnose one session file."""
    from daq.session_file import read_session
    from mesotap.commands.answers import write_json

    known = mechanisms()
    for name in without:
        if name not in known:
            raise RecordingError(f"{name!r} is no mechanism; mesotap mechanisms lists them")
    began = time.monotonic()
    session = read_session(file)
    with console.status("reading") as status:
        found = diagnose_session(
            session, [m for m in known.values() if m.id not in without], lambda stage: status.update(f"{stage} ...")
        )
    write_json(json, diagnosis_answer(found, time.monotonic() - began))
    print_diagnosis(found, console)


def list_mechanisms(console: Console) -> None:
    """Print what can be named."""
    table = Table(title="Mechanisms")
    for heading in ("id", "component", "what it is", "parameters"):
        table.add_column(heading)
    for m in mechanisms().values():
        table.add_row(m.id, m.component, m.summary, ", ".join(q.name for q in m.parameters))
    console.print(table)
