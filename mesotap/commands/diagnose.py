"""`mesotap diagnose` and `mesotap mechanisms`."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from analysis.mismatch.diagnosis import Diagnosis, diagnose_session
from analysis.results import SessionResults
from daq.errors import RecordingError
from daq.exchange.tables import NoTable
from daq.records import Session
from mesotap.answers.diagnosis_files import diagnosis_answer, print_diagnosis
from mesotap.operator.terminal import escape
from sim_backend.mechanisms.mechanism import Mechanism, element_mechanisms, mechanisms


def diagnose(
    files: Sequence[Path], json: Path | None, without: Sequence[str], report: Path | None, console: Console
) -> None:
    """Diagnose a session file, or several of one rig together."""
    from daq.session_file import read_session
    from mesotap.commands.outputs import write_json

    known = known_mechanisms(without)
    sessions = [read_session(file) for file in files]
    found, answer = diagnosed(sessions, known, console)
    write_json(json, answer)
    print_diagnosis(found, console)
    if report is not None:
        page = report_of(report, sessions, found, answer, known, console)
        console.print(f"report {escape(page)}", highlight=False, soft_wrap=True)


def known_mechanisms(without: Sequence[str] = ()) -> dict[str, Mechanism]:
    """Return the mechanisms by id, those struck from the list left out."""
    known = dict(mechanisms())
    for name in without:
        if known.pop(name, None) is None:
            raise RecordingError(f"{name!r} is no mechanism; mesotap mechanisms lists them")
    return known


def diagnosed(
    sessions: Sequence[Session], known: Mapping[str, Mechanism], console: Console
) -> tuple[Diagnosis, dict[str, Any]]:
    """Diagnose sessions under a progress line; return the diagnosis and the answer for programs."""
    began = time.monotonic()
    with console.status("reading") as status:
        found = diagnose_session(sessions, list(known.values()), lambda stage: status.update(f"{stage} ..."))
    return found, diagnosis_answer(found, time.monotonic() - began)


def report_of(
    folder: Path,
    sessions: Sequence[Session],
    found: Diagnosis,
    answer: dict[str, Any],
    known: Mapping[str, Mechanism],
    console: Console,
    results: SessionResults | None = None,
) -> Path:
    """Write the page of a diagnosis under a progress line; analyse a single session for it if ``results`` is None."""
    from analysis.session import analyse_session
    from analysis.settings import AnalysisSettings
    from calibration.settings import CalibrationSettings
    from mesotap.report.diagnosis_report import write_diagnosis
    from rig.settings import RigSettings

    with console.status("drawing") as status:
        if results is None and len(sessions) == 1:
            status.update("following the modes along the ring-downs ...")
            rig = RigSettings()
            results = analyse_session(
                sessions[0],
                AnalysisSettings(),
                CalibrationSettings(),
                rig.masses,
                rig.springs,
                lambda done, total: None,
            )
        return write_diagnosis(folder, found, answer, known, results, lambda stage: status.update(f"{stage} ..."))


def diagnose_finished(folder: Path, session: Session, results: SessionResults, console: Console) -> Path:
    """Diagnose a session at its end; write ``diagnosis.html`` and ``diagnosis.json`` into its folder."""
    known = known_mechanisms()
    found, answer = diagnosed([session], known, console)
    print_diagnosis(found, console)
    page = report_of(folder, [session], found, answer, known, console, results)
    console.print(f"diagnosis    {escape(page)}", highlight=False, soft_wrap=True)
    return page


def adopt(diagnosis: Path, config_path: Path | None, output: Path, console: Console) -> None:
    """Write a configuration whose simulated rig is the one that was diagnosed."""
    from mesotap.answers.adoption import read_diagnosis, with_model, write_adopted
    from mesotap.configuration.config import load_config

    model = read_diagnosis(diagnosis)
    write_adopted(output, with_model(load_config(config_path), model))
    console.print(
        f"{escape(output)}: simulated rig with {' and '.join(model.mechanisms)}"
        + (f", k_c and zeta_c at {len(model.loads)} loads as fitted" if len(model.loads) > 1 else ""),
        highlight=False,
        soft_wrap=True,
    )


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
    from mesotap.answers.rig_answers import print_rig_diagnosis, rig_answer
    from mesotap.commands.outputs import write_json
    from mesotap.commands.recordings import show_left_out
    from mesotap.configuration.rig_files import load_rig

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
        show_left_out(recordings[-1], console)
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
        from mesotap.report.rig_report import write_rig_report

        console.print(f"  report: {escape(write_rig_report(found, answer, report))}")


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
