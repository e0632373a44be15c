"""``analyze``, ``report`` and ``published``: what analyses files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from analysis.modal.exponentials import FitFailure
from analysis.modal.identify import decay_begins
from analysis.results import RecordingModes, SessionResults
from analysis.session import AnalysisError
from daq.errors import RecordingError
from daq.exchange import Recording
from daq.records import Session
from mesotap.answers.assurance import Beside, beside, with_beside
from mesotap.answers.frequency_response import response_json, show_response
from mesotap.answers.provenance import provenance, recording_provenance
from mesotap.answers.recording_modes import modes_of
from mesotap.answers.results_files import modes_json, results_json
from mesotap.answers.rounding import significant, with_uncertainty
from mesotap.commands.answers import analysed, show_session, writing_report
from mesotap.commands.force_channel import ForceOptions, by_force
from mesotap.commands.outputs import make_ready, write_json
from mesotap.commands.recordings import opened as opened_file
from mesotap.commands.recordings import opened_session, session_file, show_left_out, show_remarks
from mesotap.commands.session import partial
from mesotap.configuration.config import Config, ConfigError, effective_text, load_config, parse_config
from mesotap.configuration.usual_recordings import recording_remarks, refused_records, session_remarks
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape
from mesotap.session.header import kept_config

if TYPE_CHECKING:
    from mesotap.answers.correction import Correction

METHODS = ("ml", "era")
NO_FORCE = ForceOptions()


@dataclass(frozen=True, slots=True)
class _About:
    """What is unusual about a recording, and where it comes from."""

    remarks: tuple[str, ...]
    origin: dict[str, Any]


def analyze(
    files: Sequence[Path],
    method: str | None,
    rate: float | None,
    config_path: Path | None,
    changes: Sequence[str],
    report: Path | None,
    json_path: Path | None,
    console: Console,
    model: Path | None = None,
    mac: Path | None = None,
    force: ForceOptions = NO_FORCE,
    clock_ppm: float | None = None,
    decay_from_s: float | None = None,
) -> None:
    """Analyse each file, print its table, and write the answers: one, or a list of them for several files.

    ``mac`` is a recording beside whose modes those of each file are put; ``clock_ppm`` how far the recorder's clock
    may be off; ``decay_from_s`` where the free decay of a recording begins.
    """
    if method is not None and method not in METHODS:
        raise ConfigError(f"--method {method}: allowed are {' and '.join(METHODS)}")
    changes = [*changes, *([f"analysis.method={method}"] if method else [])]
    changes += [] if clock_ppm is None else [f"rig.wiring.clock_accuracy_ppm={clock_ppm}"]
    other = None if mac is None else _other(mac, rate, load_config(config_path, changes))
    if len(files) == 1:
        write_json(
            json_path,
            _analyze_one(files[0], rate, config_path, changes, report, console, model, other, force, decay_from_s),
        )
        return
    make_ready(None, report)
    answers: list[dict[str, Any]] = []
    refusals: list[str] = []
    for number, file in enumerate(files):
        # session files are often all called alike: the folder's name tells them apart
        folder = None if report is None else report / f"{number:02d}-{file.resolve().parent.name}-{file.stem}"
        try:
            answers.append(
                _analyze_one(file, rate, config_path, changes, folder, console, model, other, force, decay_from_s)
            )
        except (RecordingError, AnalysisError, FitFailure) as error:
            refusals.append(str(error))
            answers.append({"format": "mesotap-refusal", "version": 1, "source": str(file), "reason": str(error)})
    write_json(json_path, answers)
    if refusals:
        raise RecordingError("; ".join(refusals))


def _analyze_one(
    file: Path,
    rate: float | None,
    config_path: Path | None,
    changes: Sequence[str],
    report: Path | None,
    console: Console,
    model: Path | None,
    other: tuple[Recording, RecordingModes] | None,
    force: ForceOptions,
    decay_from_s: float | None,
) -> dict[str, Any]:
    opened = opened_file(file, rate)
    if isinstance(opened, Session) and opened.rig.is_tester:
        if decay_from_s is not None:
            raise RecordingError(
                f"{file}: is a session of the tester, whose taps begin where they begin; --decay-from is for other "
                "recordings"
            )
        if other is not None:
            raise RecordingError(f"{file}: is a session of the tester; --mac compares the modes of other recordings")
        if force.driving_point is not None:
            raise RecordingError(f"{file}: is a session of the tester, which has no accelerometer on the mass struck")
        config = config_for(opened, config_path, changes, console)
        return _analyze_session(file, opened, config, report, console, model)
    if isinstance(opened, Session):
        unusual = [*refused_records(opened), *session_remarks(opened)]
    else:
        unusual = recording_remarks(opened)
    show_remarks(unusual, console)
    if model is not None:
        raise RecordingError(f"{file}: is not a session of the tester, so no diagnosis of one corrects it")
    recording = _as_recording(opened) if isinstance(opened, Session) else opened
    try:
        decay_begins(decay_from_s, recording.data.shape[1], recording.rate_hz)
    except FitFailure as error:
        raise RecordingError(f"{file}: {error} (--decay-from)") from error
    recording = replace(recording, decay_from_s=decay_from_s)
    show_left_out(recording, console)
    config = load_config(config_path, changes)
    created = opened.created if isinstance(opened, Session) else None
    about = _About(tuple(unusual), recording_provenance(session_file(file), config, created))
    return _analyze_recording(recording, config, report, console, other, force, about)


def _analyze_session(
    file: Path, session: Session, config: Config, report: Path | None, console: Console, model: Path | None
) -> dict[str, Any]:
    """Loads of a session of the tester, corrected by a diagnosis if there is one."""
    try:
        correction = None if model is None else _corrected(session, model, config.analysis.mechanisms, console)
        if report is not None:
            results = _session_report(file, session, config, report, console, correction)
        else:
            results = analysed(session, config, console)
    except (AnalysisError, FitFailure):  # which what is unusual may explain
        show_remarks(session_remarks(session), console)
        raise
    show_session(results, console)
    answer = {**results_json(results), "provenance": provenance(session, config, session_file(file))}
    if correction is None:
        return answer
    from mesotap.answers.correction import show_correction, with_correction

    show_correction(correction, console)
    return with_correction(answer, correction)


def _analyze_recording(
    recording: Recording,
    config: Config,
    report: Path | None,
    console: Console,
    other: tuple[Recording, RecordingModes] | None,
    force: ForceOptions,
    about: _About,
) -> dict[str, Any]:
    """Modes of a recording that is no session, and its frequency responses where a channel of it is a force."""
    make_ready(None, report)
    found = by_force(recording, force, lambda text: console.print(f"- {escape(text)}", highlight=False, soft_wrap=True))
    motions, told = found.motions, {}
    if force.driving_point is not None:
        from mesotap.commands.driving_point import by_driving_point, driving_point_json, show_driving_point

        both = by_driving_point(recording, force, config)
        show_driving_point(both, console)
        told = {"driving_point": driving_point_json(both)}
    try:
        modes = modes_of(motions, config.analysis.method, config.rig.wiring)
    except FitFailure as error:
        if found.response is None:
            raise
        # what is driven all the time has no ring-down, and its responses are as good as ever
        modes = RecordingModes(recording.source, config.analysis.method, (), (f"no ring-down: {error}",))
    _show_modes(modes, console)
    responses = found.response
    if responses is not None:
        show_response(responses, console)
    # said already; the answer and the page hold it too
    left_out = [f"left out of the file: {what}" for what in recording.left_out]
    modes = replace(modes, notes=(*modes.notes, *left_out, *about.remarks))
    compared = None if other is None else _compared(motions, modes, other, console)
    if report is not None:
        from mesotap.report.report import recording_report

        with writing_report(console):
            page = recording_report(report, motions, modes, compared, responses, origin=about.origin)
        console.print(f"report {escape(page)}", highlight=False, soft_wrap=True)
    answer = with_beside(modes_json(modes), compared)
    answer |= {**told, "provenance": about.origin}
    return answer if responses is None else {**answer, "frequency_response": response_json(responses)}


def _other(file: Path, rate: float | None, config: Config) -> tuple[Recording, RecordingModes]:
    """Return the recording that others are compared with, and its modes; a force is no channel of them."""
    opened = opened_file(file, rate)
    if isinstance(opened, Session) and opened.rig.is_tester:
        raise RecordingError(f"{file}: is a session of the tester; --mac compares the modes of other recordings")
    recording = _as_recording(opened) if isinstance(opened, Session) else opened
    motions = by_force(recording, NO_FORCE, lambda text: None).motions
    return motions, modes_of(motions, config.analysis.method, config.rig.wiring)


def _compared(
    recording: Recording, modes: RecordingModes, other: tuple[Recording, RecordingModes], console: Console
) -> Beside:
    found = beside(modes, recording.names, other[1], other[0].names)
    _show_mac("modal assurance criterion between the recordings", modes, found.other, found.mac, console)
    said = f"- a row a mode of {escape(modes.source)}, a column a mode of {escape(found.other.source)}"
    console.print(said, highlight=False, soft_wrap=True)
    if found.matched_by_order:
        pairs = ", ".join(f"{first} with {second}" for first, second in found.channels)
        said = f"- channels are compared in their order: {escape(pairs)}"
        console.print(said, highlight=False, soft_wrap=True)
    return found


def _corrected(session: Session, model: Path, folders: Sequence[str], console: Console) -> Correction:
    from mesotap.answers.adoption import read_diagnosis
    from mesotap.answers.correction import correct

    with console.status("fitting the model of the diagnosis ..."):
        return correct(session, read_diagnosis(model), folders)


def config_for(session: Session, config_path: Path | None, changes: Sequence[str], console: Console) -> Config:
    """Return the configuration named on the command line, else the session's own, else the defaults.

    Masses and springs are always the session's: a change of them is refused, not ignored.
    """
    for change in changes:
        if re.match(r"\s*rig\.(masses\.m|springs\.(k|system))", change):
            raise ConfigError(f"--set {change}: masses and springs are those written in {session.source}")
    if config_path is not None:
        return load_config(config_path, changes)
    try:
        kept = kept_config(session.config, f"{session.source}: /config")
        own = kept.config
        for difference in kept.differences():
            console.print(f"- {escape(session.source)}: {escape(difference)}", highlight=False)
    except ConfigError:
        # written by another version or program; the recording is as good as ever
        console.print(
            f"- {escape(session.source)}: its own configuration is of another version; defaults are used",
            highlight=False,
        )
        own = Config()
    return parse_config(effective_text(own), "--set", changes)


def _as_recording(session: Session) -> Recording:
    """Return the first accepted impact of a session without a known rig, with all channels it has."""
    impacts = [s for s in session.impacts if s.accepted] or list(session.impacts)
    if not impacts:
        raise RecordingError(f"{session.source}: holds no impacts")
    impact = impacts[0]
    data = impact.acceleration if impact.channels is None else impact.channels
    names = impact.channel_names if impact.channels is not None else ("A", "B")
    return Recording(data, impact.sample_rate_hz, tuple(names), "m/s2", session.source)


def write_session_report(
    source: Path,
    output: Path | None,
    config_path: Path | None,
    changes: Sequence[str],
    json_path: Path | None,
    console: Console,
) -> None:
    """Write the report of a session file or folder."""
    opened = opened_session(source, console)
    if not isinstance(opened, Session) or not opened.rig.is_tester:
        raise RecordingError(
            f"{source}: is not a session of the tester; 'mesotap analyze --report' reports any other file"
        )
    default = source if source.is_dir() else source.parent / f"{source.stem}-report"
    config = config_for(opened, config_path, changes, console)
    results = _session_report(source, opened, config, output or default, console)
    show_remarks(results.remarks, console)
    origin = provenance(opened, config, session_file(source))
    write_json(json_path, {**results_json(results), "provenance": origin})


def _session_report(
    source: Path,
    session: Session,
    config: Config,
    folder: Path,
    console: Console,
    correction: Correction | None = None,
) -> SessionResults:
    from analysis.contact.theory import theory
    from mesotap.report.report import write_report

    make_ready(None, folder)
    truths = partial(source)[2] if source.is_dir() else []
    results = analysed(session, config, console)
    with writing_report(console) as on_progress:
        page = write_report(
            folder,
            session,
            results,
            theory(config.analysis.contact),
            truths or None,
            contact=config.analysis.contact,
            correction=correction,
            origin=provenance(session, config, session_file(source)),
            on_progress=on_progress,
        )
    console.print(f"report {escape(page)}", highlight=False, soft_wrap=True)
    return results


def _show_mac(
    title: str, first: RecordingModes, second: RecordingModes, mac: NDArray[np.float64], console: Console
) -> None:
    """Print the modal assurance criterion, a row a mode of the first recording and a column a mode of the second."""
    shown = Table(title=title)
    shown.add_column("Hz", justify="right")
    for mode in second.modes:
        shown.add_column(significant(mode.frequency_hz.value, 5), justify="right")
    for mode, row in zip(first.modes, mac, strict=True):
        shown.add_row(significant(mode.frequency_hz.value, 5), *(f"{value:.2f}" for value in row))
    console.print(shown)


def _show_modes(modes: RecordingModes, console: Console) -> None:
    shown = Table(title=f"{escape(modes.source)}: {modes.method}, 95 % intervals")
    for heading in ("frequency, Hz", "damping, %", "largest amplitude", "EMAC", "MPC"):
        shown.add_column(heading, justify="right")
    for mode in modes.modes:
        shown.add_row(
            with_uncertainty(mode.frequency_hz),
            with_uncertainty(mode.damping_ratio, 100),
            f"{max(mode.amplitude):.4g}",
            *("\N{EN DASH}" if np.isnan(share) else f"{share:.2f}" for share in (mode.emac, mode.mpc)),
        )
    console.print(shown)
    if len(modes.modes) > 1 and len(modes.modes[0].shape) > 1:
        _show_mac("modal assurance criterion between the modes (auto-MAC)", modes, modes, modes.mac(), console)
    for note in modes.notes:
        console.print(f"- {escape(note)}", highlight=False)
