"""``info`` and ``import``: what needs no analysis, and does not wait for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from daq.bounds import ANY, RATE
from daq.errors import RecordingError
from daq.exchange import Recording, as_session, import_recording
from daq.hits import LEFT_OUT, is_left_out
from daq.records import Impact, Session
from daq.session_file import read_session, write_session
from mesotap.commands.outputs import write_json
from mesotap.configuration.usual_recordings import recording_remarks, refused_records, session_remarks
from mesotap.operator.terminal import escape

SESSION_FILE = "session.h5"
NO_SESSION = "is not a session file"
SESSION_SUFFIXES = (".h5", ".hdf5")


def opened(file: Path, rate: float | None) -> Session | Recording:
    """Return what a file, or the folder of a session, holds; ``rate`` (Hz) of a recording that does not say."""
    if file.is_dir():
        finished = file / SESSION_FILE
        if finished.exists():
            return read_session(finished)
        from mesotap.commands.session import partial

        return partial(file)[0]
    if file.suffix.lower() in SESSION_SUFFIXES:
        try:
            return read_session(file)
        except RecordingError as error:
            if NO_SESSION not in str(error):
                raise
            raise RecordingError(f"{error}; of another program's recording 'mesotap import' makes one") from error
    return believed(import_recording(file, rate_hz=rate))


def session_file(path: Path) -> Path:
    """Return the session file of a folder, there or not yet; a file is itself."""
    return path / SESSION_FILE if path.is_dir() else path


def believed(recording: Recording) -> Recording:
    """Return a recording whose rate and samples are such that numbers come of them.

    Raises
    ------
    RecordingError
        They are not.
    """
    fault = RATE.fault(recording.rate_hz)
    if fault:
        raise RecordingError(f"{recording.source}: its sampling rate {fault}")
    for channel, samples in enumerate(recording.data):
        fault = ANY.fault_of_all(samples)
        if fault:
            raise RecordingError(f"{recording.source}: channel {recording.names[channel]} {fault}")
    return recording


def import_file(
    file: Path,
    output: Path | None,
    rate: float | None,
    channels: Sequence[str],
    json_path: Path | None,
    console: Console,
) -> None:
    """Make a session file of another program's recording."""
    if output is None and file.name in ("", ".."):
        raise RecordingError(f"{file}: is a folder, not a recording")
    target = output or file.with_suffix(".h5")
    if target.exists() and not (target.is_file() and target.stat().st_size == 0):
        raise RecordingError(
            f"{target}: exists already and is left as it is; name another file (mesotap import {file} NEW.h5)"
        )
    recording = believed(import_recording(file, rate_hz=rate))
    unusual = recording_remarks(recording)
    show_remarks(unusual, console)  # before a channel may be refused for what this explains
    session = as_session(recording, _chosen(channels))
    write_session(target, session)
    impact = session.impacts[0]
    count, samples = recording.data.shape
    names = escape(", ".join(recording.names))
    console.print(
        f"{escape(target)}: {count} channels ({names}), {samples} samples at {recording.rate_hz:g} Hz; "
        f"trigger at sample {impact.pretrigger}",
        highlight=False,
        soft_wrap=True,
    )
    unknown = [
        f"{name} ({unit!r})" if unit else name for name, unit in _units_of_pair(recording, impact) if unit != "m/s2"
    ]
    if unknown:
        console.print(
            f"- {escape(file)}: no known unit of {escape(' and '.join(unknown))}: the numbers are taken as m/s2",
            highlight=False,
            soft_wrap=True,
        )
    show_left_out(recording, console)
    write_json(json_path, _recording_info(recording, target) | ({"remarks": unusual} if unusual else {}))


def _units_of_pair(recording: Recording, impact: Impact) -> list[tuple[str, str]]:
    units = dict(zip(recording.names, recording.units or (recording.unit,) * len(recording.names), strict=True))
    return [(name, units[name]) for name in impact.extra["channels_as_a_and_b"]]


def show_remarks(remarks: Sequence[str], console: Console) -> None:
    """Say what is unusual about a recording: it is used as it is."""
    for remark in remarks:
        console.print(f"- {escape(remark)}", highlight=False, soft_wrap=True)


def show_left_out(recording: Recording, console: Console) -> None:
    """Say what in the file looks like a channel and is none of the recording."""
    if recording.left_out:
        more = f" and {len(recording.left_out) - 10} more" if len(recording.left_out) > 10 else ""
        console.print(
            f"- {escape(recording.source)}: left out: {escape(', '.join(recording.left_out[:10]))}{more}",
            highlight=False,
            soft_wrap=True,
        )


def opened_session(file: Path, console: Console) -> Session | Recording:
    """Return what a file, or the folder of a session, holds, and say which of its records cannot be read."""
    found = opened(file, None)
    if isinstance(found, Session):
        show_remarks(refused_records(found), console)
    return found


def _chosen(channels: Sequence[str]) -> tuple[str | int, str | int] | None:
    if not channels:
        return None
    if len(channels) != 2:
        raise RecordingError(f"--channel: name two channels, A then B, not {len(channels)}")
    first, second = (int(c) if c.isdigit() else c for c in channels)
    return first, second


def info(file: Path, json_path: Path | None, console: Console) -> None:
    """Say what a file holds."""
    found = opened(file, None)
    if isinstance(found, Session):
        answer, unusual = _session_info(found, file), [*refused_records(found), *session_remarks(found)]
    else:
        answer, unusual = _recording_info(found, file), recording_remarks(found)
    for key, value in answer.items():
        shown = ", ".join(map(str, value)) if isinstance(value, list) else value
        console.print(f"{key.replace('_', ' ')}: {escape(str(shown))}", highlight=False)
    show_remarks(unusual, console)
    write_json(json_path, answer | ({"remarks": unusual} if unusual else {}))


def _session_info(session: Session, file: Path) -> dict[str, Any]:
    accepted = sum(s.accepted for s in session.impacts)
    rig = session.rig
    return {
        "file": str(file),
        "kind": "mesotap-session 1",
        "created": session.created,
        "operator": session.operator,
        "specimen": session.specimen,
        "title": session.title,
        "software": session.software,
        "complete": session.complete,
        "impacts": len(session.impacts),
        "accepted": accepted,
        **_left_out(session),
        "loads_mn": [
            "unknown" if math.isnan(load) else round(load, 3)
            for load in (_target(session, load_set) for load_set in session.load_sets())
        ],
        "calibrations": [w for w, c in (("before", session.pre), ("after", session.post)) if c is not None],
        "rig": f"m1 {rig.m1_kg:g} kg, m2 {rig.m2_kg:g} kg, k1 {rig.k1_n_per_m:g} N/m, k2 {rig.k2_n_per_m:g} N/m"
        + (f", {1e3 * rig.tube_added_kg:.3g} g of each tube spring in the masses" if rig.tube_added_kg else "")
        if rig.is_tester
        else "not described: no session of the tester",
    }


def _left_out(session: Session) -> dict[str, list[str]]:
    """Return the taps that are not used because others were chosen, each with its reason."""
    said = [f"{i.number} ({i.reject_reason.removeprefix(LEFT_OUT)})" for i in session.impacts if is_left_out(i)]
    return {"left_out": said} if said else {}


def _target(session: Session, load_set: int) -> float:
    return next(s.target_load_mn for s in session.impacts if s.load_set == load_set)


def _recording_info(recording: Recording, file: Path) -> dict[str, Any]:
    return {
        "file": str(file),
        "kind": "recording",
        "channels": list(recording.names),
        "unit": recording.unit,
        **({"units": list(recording.units)} if len(set(recording.units)) > 1 else {}),
        **({"left_out": list(recording.left_out)} if recording.left_out else {}),
        "samples": int(recording.data.shape[1]),
        "sample_rate_hz": recording.rate_hz,
        "duration_s": recording.data.shape[1] / recording.rate_hz,
    }
