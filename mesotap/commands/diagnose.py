"""`mesotap diagnose`, `mesotap adopt` and the list of `mesotap mechanisms`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from analysis.mismatch.answer import RecordingFile
from analysis.mismatch.diagnosis import Diagnosis, diagnose_recordings, diagnose_sessions
from analysis.mismatch.recordings.steady import Sweep, sweeps_of
from analysis.mismatch.rig_description import DescribedRig
from analysis.results import SessionResults
from analysis.session import AnalysisError
from daq.errors import RecordingError
from daq.exchange import Recording, import_recording
from daq.exchange.tables import NoTable, import_tables
from daq.records import Session
from mesotap.answers.diagnosis_json import Version, diagnosis_json
from mesotap.answers.diagnosis_text import print_answer
from mesotap.answers.recording_files import recording_files, sha256_of
from mesotap.commands.answers import telling, writing_report
from mesotap.commands.outputs import write_json
from mesotap.configuration.declared import header_uncertainty, rig_settings
from mesotap.configuration.rig_files import load_rig, tester_rig
from mesotap.operator.tables import Table
from mesotap.operator.terminal import complain, escape
from sim_backend.mechanisms.catalogue import catalogue, left_out, variants
from sim_backend.mechanisms.catalogue import without as left_without
from sim_backend.mechanisms.kinds import AddedBody, ChannelDistortion, ForceLaw, Mechanism, SecondImpact, Tones

Known = Mapping[str, tuple[Mechanism, ...]]
"""Variants of mechanisms by id."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What a diagnosis is asked for, beside its files.

    Attributes
    ----------
    rig
        Description of the rig; None for the two-mass tester.
    config
        Configuration that names folders of a user's own mechanisms.
    without
        Mechanisms that are excluded.
    json, report
        Where to write the answer and the page.
    learn
        Whether laws that nobody listed compete.
    """

    rig: Path | None = None
    config: Path | None = None
    without: Sequence[str] = ()
    json: Path | None = None
    report: Path | None = None
    contract: Version = 2
    learn: bool = True


@dataclass(frozen=True, slots=True)
class Read:
    """What was read of the files: sessions, or recordings with steady responses; ``remarks``: what is unusual of it."""

    rig: DescribedRig
    files: tuple[RecordingFile, ...]
    sessions: tuple[Session, ...] = ()
    recordings: tuple[Recording, ...] = ()
    sweeps: tuple[Sweep, ...] = ()
    remarks: tuple[str, ...] = ()


def diagnose(files: Sequence[Path], asked: Asked, console: Console) -> None:
    """Diagnose session files of one rig, or recordings of a described one."""
    from mesotap.commands.outputs import make_ready

    known = known_mechanisms(asked.without, own_folders(asked.config))
    read = read_files([file_of(file) for file in files], asked.rig, console)
    make_ready(asked.json, asked.report)
    began = time.monotonic()
    found = diagnosed(read, known, console, learn=asked.learn)
    content = diagnosis_json(found.answer, time.monotonic() - began, asked.contract)
    content |= {"remarks": list(read.remarks)} if read.remarks else {}
    write_json(asked.json, content)
    print_answer(found.answer, console)
    if asked.report is not None:
        page = report_of(asked.report, read, (found, content), known, console)
        console.print(f"report {escape(page)}", highlight=False, soft_wrap=True)


def read_files(files: Sequence[Path], rig_file: Path | None, console: Console) -> Read:
    """Read the files; a further file that holds steady responses of a described rig is taken for them."""
    from mesotap.commands.recordings import believed, show_left_out, show_remarks
    from mesotap.configuration.usual_recordings import (
        recording_remarks,
        refused_records,
        rig_remarks,
        session_remarks,
    )

    rig = tester_rig() if rig_file is None else load_rig(rig_file)
    if rig_file is None or _is_session(files[0]):
        sessions = tuple(_session(file, rig_file is None) for file in files)
        unusual = [one for session in sessions for one in (*refused_records(session), *session_remarks(session))]
        show_remarks(unusual, console)
        return Read(rig, recording_files(files), sessions, remarks=tuple(unusual))
    recordings: list[Recording] = []
    sweeps: list[Sweep] = []
    for place, file in enumerate(files):
        if rig.sweeps is not None and place > 0:
            columns = rig.sweeps
            try:
                wanted = (columns.frequency, columns.force, columns.amplitude, columns.phase)
                sweeps += sweeps_of(rig, import_tables(file, wanted), str(file))
                continue
            except NoTable:
                pass
        recordings.append(believed(import_recording(file, rig.rate_hz)))
        show_left_out(recordings[-1], console)
    unusual = [one for r in recordings for one in (*recording_remarks(r, rate=False), *rig_remarks(rig, r))]
    show_remarks(unusual, console)
    return Read(rig, recording_files(files), (), tuple(recordings), tuple(sweeps), tuple(unusual))


def file_of(path: Path) -> Path:
    """Return the session file of a session's folder; anything else as it is."""
    from mesotap.commands.recordings import SESSION_FILE

    if not path.is_dir():
        return path
    file = path / SESSION_FILE
    if not file.exists():
        raise RecordingError(
            f"{path}: holds no {SESSION_FILE} yet; finish the session with 'mesotap resume {path}', or "
            f"'mesotap recover {path}' makes one of what is there"
        )
    return file


def _session(file: Path, of_tester: bool) -> Session:
    """Read a session; of what is no session file, say how a recording of another rig is diagnosed."""
    from daq.session_file import read_session
    from mesotap.commands.recordings import SESSION_SUFFIXES

    try:
        return read_session(file)
    except RecordingError as exc:
        if not of_tester or not file.is_file() or file.suffix.lower() in SESSION_SUFFIXES:
            raise
        raise RecordingError(
            f"{exc}; a recording of another rig needs that rig's description: --rig RIG.YAML "
            f"('mesotap rig init {file}' writes a first one)"
        ) from exc


def _is_session(file: Path) -> bool:
    """Whether a file holds a session: HDF5 files of other programs do not."""
    from daq.session_file import read_session
    from mesotap.commands.recordings import SESSION_SUFFIXES

    if file.suffix.lower() not in SESSION_SUFFIXES:
        return False
    try:
        read_session(file)
    except RecordingError:
        return False
    return True


def known_mechanisms(without: Sequence[str] = (), folders: Sequence[str] = ()) -> Known:
    """Return the variants of all mechanisms by id, those of a user's folders among them; ``without`` are left out.

    What installed packages offer and cannot be used is named on standard error.
    """
    for fault in left_out(folders):
        complain(f"mesotap: cannot be used and is left out: {fault}")
    return left_without(catalogue(folders), without)


def own_folders(config: Path | None) -> tuple[str, ...]:
    """Return the folders of a user's own mechanisms that a configuration names."""
    from mesotap.configuration.config import load_config

    return load_config(config).analysis.mechanisms


def diagnosed(
    read: Read,
    known: Known,
    console: Console,
    told: Callable[[str], None] = lambda stage: None,
    learn: bool = True,
) -> Diagnosis:
    """Diagnose what was read under a progress line."""
    listed = variants(known)
    with telling(console, "diagnosing") as tell:

        def on_progress(stage: str) -> None:
            tell(stage)
            told(stage)

        if not read.sessions:
            return diagnose_recordings(read.recordings, read.rig, listed, on_progress, read.files, read.sweeps, learn)
        uncertainty = header_uncertainty(read.sessions[0])
        return diagnose_sessions(read.sessions, read.rig, uncertainty, listed, on_progress, read.files, learn)


def report_of(
    folder: Path,
    read: Read,
    diagnosis: tuple[Diagnosis, dict[str, Any]],
    known: Known,
    console: Console,
    results: SessionResults | None = None,
) -> Path:
    """Write the page of a diagnosis under a progress line; analyse a single session for it if ``results`` is None."""
    # drawing takes its time to load, which an answer without a page need not wait for
    from mesotap.answers.diagnosis_page import write_page
    from mesotap.answers.evidence import evidence_of

    found, content = diagnosis
    with writing_report(console) as on_progress:
        if results is None and len(read.sessions) == 1 and read.sessions[0].rig.is_tester:
            on_progress("following the modes along the ring-downs")
            results = _analysed(read.sessions[0])
        on_progress("drawing")
        behind = evidence_of(found, known, results)
        return write_page(folder, found.answer, behind, content, read.sessions, on_progress=on_progress)


def _analysed(session: Session) -> SessionResults | None:
    """Return the linear analysis of a session with what its own configuration declares; None where it has none."""
    from analysis.session import analyse_session
    from analysis.settings import AnalysisSettings
    from calibration.settings import CalibrationSettings

    rig = rig_settings(session)
    try:
        return analyse_session(
            session, AnalysisSettings(), CalibrationSettings(), rig.masses, rig.springs, wiring=rig.wiring
        )
    except AnalysisError:
        return None


def diagnose_finished(
    folder: Path,
    session: Session,
    results: SessionResults,
    console: Console,
    folders: Sequence[str] = (),
    told: Callable[[str], None] = lambda stage: None,
) -> Path:
    """Diagnose a session at its end, and tell each stage; write ``diagnosis.html`` and ``diagnosis.json``."""
    known = known_mechanisms(folders=folders)
    began = time.monotonic()
    file = RecordingFile(session.source, sha256_of(folder / session.source))
    read = Read(tester_rig(), (file,), (session,))
    found = diagnosed(read, known, console, told)
    content = diagnosis_json(found.answer, time.monotonic() - began)
    print_answer(found.answer, console)
    page = report_of(folder, read, (found, content), known, console, results)
    console.print(f"diagnosis    {escape(page)}", highlight=False, soft_wrap=True)
    return page


def adopt(diagnosis: Path, config_path: Path | None, output: Path, json_path: Path | None, console: Console) -> None:
    """Write a configuration whose simulated rig is the one that was diagnosed."""
    from mesotap.answers.adoption import read_diagnosis, with_model, write_adopted
    from mesotap.configuration.config import load_config

    model = read_diagnosis(diagnosis)
    write_adopted(output, with_model(load_config(config_path), model))
    console.print(
        f"{escape(output)}: simulated rig with {' and '.join(model.mechanisms)}"
        + (f", k_c and zeta2 at {len(model.loads)} loads as fitted" if len(model.loads) > 1 else ""),
        highlight=False,
        soft_wrap=True,
    )
    write_json(
        json_path, {"configuration": str(output), "mechanisms": list(model.mechanisms), "loads": len(model.loads)}
    )


def list_mechanisms(config: Path | None, json_path: Path | None, console: Console) -> None:
    """Print what can be named."""
    table = Table(title="Mechanisms")
    for heading in ("id", "component", "acts in", "what it is", "parameters"):
        table.add_column(heading)
    known = variants(known_mechanisms(folders=own_folders(config)))
    for m in known:
        table.add_row(m.id, m.component, _acts_in(m), m.summary, ", ".join(q.name for q in m.parameters))
    console.print(table)
    hidden = [m for m in known if m.hidden]
    if hidden:
        console.print("Not sought in free decays, which do not show them by themselves; all can be simulated:")
    for m in hidden:
        console.print(f"{m.id}: {m.hidden}", highlight=False)
    faults = left_out(own_folders(config))
    write_json(json_path, {"mechanisms": [_described(m) for m in known]} | ({"left_out": faults} if faults else {}))


def _described(mechanism: Mechanism) -> dict[str, Any]:
    quantities = [{"name": q.name, "unit": q.unit, "meaning": q.meaning} for q in mechanism.parameters]
    return {
        "id": mechanism.id,
        "component": mechanism.component,
        "acts_in": _acts_in(mechanism),
        "summary": mechanism.summary,
        "source": mechanism.source,
        "parameters": quantities,
        "hidden_in_free_decays": mechanism.hidden,
    }


def _acts_in(mechanism: Mechanism) -> str:
    if isinstance(mechanism, ForceLaw):
        load = {True: " under preload", False: " without preload", None: ""}[mechanism.preloaded]
        return ", ".join(mechanism.fits) + load
    words = {AddedBody: "bodies and elements", Tones: "every channel", SecondImpact: "bodies"}
    return mechanism.of if isinstance(mechanism, ChannelDistortion) else words[type(mechanism)]
