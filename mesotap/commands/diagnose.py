"""`mesotap diagnose` and `mesotap mechanisms`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from analysis.mismatch.diagnosis import diagnose_session
from daq.errors import RecordingError
from daq.exchange.tables import NoTable
from mesotap.diagnosis_files import diagnosis_answer, print_diagnosis
from sim_backend.mechanisms.mechanism import element_mechanisms, mechanisms


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


def diagnose_described(
    files: Sequence[Path],
    rig_file: Path,
    json: Path | None,
    without: Sequence[str],
    report: Path | None,
    console: Console,
) -> None:
    """Diagnose recordings of a rig described in YAML; a further file that holds its sweeps is taken for them."""
    from analysis.mismatch.rigs.diagnosis import diagnose_rig
    from analysis.mismatch.rigs.steady import sweeps_of
    from daq.exchange import import_recording
    from daq.exchange.tables import import_tables
    from mesotap.commands.answers import write_json
    from mesotap.rig_answers import print_rig_diagnosis, rig_answer
    from mesotap.rig_files import load_rig

    known = element_mechanisms()
    for name in without:
        if name not in known:
            raise RecordingError(f"{name!r} is no mechanism of a described rig; mesotap mechanisms lists them")
    began = time.monotonic()
    rig = load_rig(rig_file)
    recordings, sweeps = [], []
    for place, file in enumerate(files):
        columns = rig.sweeps
        if columns is not None and place > 0:
            try:
                wanted = (columns.frequency, columns.force, columns.amplitude, columns.phase)
                sweeps += sweeps_of(rig, import_tables(file, wanted), str(file))
                continue
            except NoTable:
                pass
        recordings.append(import_recording(file, rig.rate_hz))
    with console.status("reading") as status:
        found = diagnose_rig(
            rig,
            recordings,
            [m for m in known.values() if m.id not in without],
            lambda stage: status.update(f"{stage} ..."),
            sweeps,
        )
    answer = rig_answer(found, time.monotonic() - began)
    write_json(json, answer)
    print_rig_diagnosis(found, console)
    if report is not None:
        from mesotap.rig_report import write_rig_report

        console.print(f"  report: {write_rig_report(found, answer, report)}")


def list_mechanisms(console: Console) -> None:
    """Print what can be named."""
    for title, known in (
        ("Mechanisms of the tester", mechanisms()),
        ("Mechanisms of a described rig (--rig)", element_mechanisms()),
    ):
        table = Table(title=title)
        for heading in ("id", "component", "what it is", "parameters"):
            table.add_column(heading)
        for m in known.values():
            table.add_row(m.id, m.component, m.summary, ", ".join(q.name for q in m.parameters))
        console.print(table)
