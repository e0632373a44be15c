"""From the files of a session to its entry in the catalogue."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import RecordingError
from daq.hdf5 import open_hdf5
from daq.journal import HEADER, JOURNAL
from daq.limited import LimitedReader
from daq.records import CalibrationPoints, Impact, Session
from daq.session_file import FORMAT, KINDS, VERSION, session_in
from mesotap.catalogue.answers_beside import (
    DIAGNOSIS,
    RESULTS,
    diagnosis_files,
    plain,
    read_results,
    read_verdict,
    result_files,
)
from mesotap.catalogue.entry import COMPLETE, DAMAGED, FOREIGN, UNFINISHED, Entry
from mesotap.catalogue.folders import read_folder
from mesotap.session.header import FOLDER_FORMAT, FOLDER_VERSION

SESSION_FILE = "session.h5"
SHORTEST_NOISE = 32
"""Samples before a tap below which they tell no noise."""

ITEMS = (SESSION_FILE, HEADER, JOURNAL)
_CHUNK = 1 << 20
_BAD_FOLDER = (RecordingError, ValueError, LookupError, TypeError, AttributeError, RecursionError, OSError)


def is_session_folder(folder: Path, names: set[str]) -> bool:
    """Return whether a folder of these ``names`` is a session's."""
    return bool(names.intersection(ITEMS))


def signature_of(session: Path) -> str:
    """Return which files a session's entry is made of: name, time of change and size of each."""
    files = [session / name for name in ITEMS] if session.is_dir() else [session]
    said = []
    for file in (*files, *result_files(session), *diagnosis_files(session)):
        try:
            status = file.stat()
        except OSError:
            continue
        said.append(f"{file.parent.name}/{file.name} {status.st_mtime_ns} {status.st_size}")
    return "\n".join(said).encode("utf-8", "backslashreplace").decode()


def content_of(session: Path) -> str:
    """Return the SHA-256 of what was recorded: the session file, or header and journal of a session that has none.

    Empty where it cannot be read.
    """
    recorded = [session] if not session.is_dir() else [session / SESSION_FILE]
    if not recorded[0].exists():
        recorded = [session / HEADER, session / JOURNAL]
    digest = hashlib.sha256()
    try:
        for file in recorded:
            if not file.is_file():
                continue
            with file.open("rb") as content:
                while part := content.read(_CHUNK):
                    digest.update(part)
    except OSError:
        return ""
    return digest.hexdigest()


def entry_of(session: Path, reader: LimitedReader, before: Entry | None = None) -> Entry | None:
    """Return the entry of a session; None for an HDF5 file of something else.

    Parameters
    ----------
    session
        Folder, or a session file that lies by itself; absolute.
    reader
        That reads session files.
    before
        The entry of earlier: where nothing else was recorded since, only the answers are read again.
    """
    sha256 = content_of(session)
    if before is not None and sha256 and before.sha256 == sha256 and before.state in (COMPLETE, UNFINISHED):
        recorded: Entry | None = replace(before, notes=())
    else:
        recorded = _recorded(session, sha256, reader)
    if recorded is None or recorded.state not in (COMPLETE, UNFINISHED):
        return recorded
    return _with_answers(session, recorded)


def _recorded(session: Path, sha256: str, reader: LimitedReader) -> Entry | None:
    bare = Entry(str(session), session.name, UNFINISHED, sha256=sha256)
    file = session / SESSION_FILE if session.is_dir() else session
    if session.is_dir() and not file.exists():
        return _unfinished(session, bare)
    try:
        return _standing(session, _from_file(reader.read(session_in, file, kinds=KINDS), bare))
    except RecordingError as error:
        kind, version = _declared(file, reader)
        if kind is not None and kind != FORMAT and not session.is_dir():
            return None
        other = kind is not None and (kind != FORMAT or version != VERSION)
        said = f"{FORMAT} {version:g}" if kind == FORMAT and version is not None and not math.isnan(version) else ""
        return replace(bare, state=FOREIGN if other else DAMAGED, reason=_said(error), format=said)


def declared_in(path: Path) -> list[Any]:
    """Return the format and version that an HDF5 file says it is of; for a process with limits."""
    with open_hdf5(path) as root:
        kind = root.attribute("format")
        return [kind if isinstance(kind, str) else "", root.number("format_version", required=False)]


def _declared(file: Path, reader: LimitedReader) -> tuple[str | None, float | None]:
    try:
        kind, version = reader.read(declared_in, file)
        return str(kind), float(version)
    except (RecordingError, TypeError, ValueError):
        return None, None


def _unfinished(folder: Path, bare: Entry) -> Entry:
    try:
        told = read_folder(folder)
    except _BAD_FOLDER as error:
        newer = isinstance(error, RecordingError) and "newer version" in str(error)
        missing = "" if (folder / HEADER).exists() else f"{folder / HEADER} is missing"
        return replace(bare, state=FOREIGN if newer else DAMAGED, reason=missing or _said(error))
    done = " (its plan is done, its session file is missing)" if told["done"] else ""
    return replace(
        bare,
        format=f"{FOLDER_FORMAT} {FOLDER_VERSION}",
        reason=(told["goes_on"] or "has no session file") + done,
        stands=told["state"],
        goes_on=told["goes_on"],
        simulated=told["simulated"],
        taps=told["taps"],
        accepted=told["accepted"],
        created=plain(told["created"]),
        operator=plain(told["operator"]),
        specimen=plain(told["specimen"]),
        title=plain(told["title"]),
        software=plain(told["software"]),
    )


def _standing(session: Path, entry: Entry) -> Entry:
    """Return an entry with where the folder stands by its journal, if it has one that can be read."""
    if not session.is_dir():
        return entry
    try:
        told = read_folder(session)
    except _BAD_FOLDER:
        return entry
    return replace(entry, stands=told["state"], goes_on=told["goes_on"])


def _from_file(session: Session, bare: Entry) -> Entry:
    good = [impact for impact in session.impacts if impact.accepted]
    slope, zero = _gauge(session)
    return replace(
        bare,
        state=COMPLETE if session.complete else UNFINISHED,
        reason="; ".join(
            [*([] if session.complete else ["the session did not reach its end"]), *map(plain, session.refused)]
        ),
        format=f"{FORMAT} {VERSION}",
        simulated="simulated rig" in session.software or "emulated" in session.software,
        taps=len(session.impacts),
        accepted=len(good),
        k1_n_per_m=_known(session.rig.k1_n_per_m),
        k2_n_per_m=_known(session.rig.k2_n_per_m),
        slope_mv_per_mn=slope,
        zero_mv=zero,
        noise_m_s2=_noise(good),
        created=plain(session.created),
        operator=plain(session.operator),
        specimen=plain(session.specimen),
        title=plain(session.title),
        software=plain(session.software),
    )


def _gauge(session: Session) -> tuple[float | None, float | None]:
    """Slope and zero of the calibrations, the mean of both where there are two."""
    lines = [line for points in (session.pre, session.post) if points is not None and (line := _line(points))]
    if not lines:
        return None, None
    slope, zero = np.mean(lines, axis=0)
    return float(slope), float(zero)


def _line(points: CalibrationPoints) -> tuple[float, float] | None:
    from calibration.line import CalibrationError, fit_line  # the console's server looks things up without the numerics

    try:
        fit = fit_line(points, 0.0)
    except CalibrationError:
        return None
    return fit.sensitivity_mv_per_mn.value, fit.offset_mv.value


def _noise(impacts: list[Impact]) -> float | None:
    """RMS before the taps, m/s2: the first half of the samples before the trigger, in which nothing has begun."""
    levels = [
        float(np.sqrt(np.mean(np.var(impact.acceleration[:, : impact.pretrigger // 2], axis=1))))
        for impact in impacts
        if impact.pretrigger >= 2 * SHORTEST_NOISE
    ]
    return float(np.median(levels)) if levels else None


def _with_answers(session: Path, entry: Entry) -> Entry:
    notes: list[str] = []
    entry = replace(entry, answer="", loads=(), drifted=None, diagnosis="", verdict="", mechanisms=(), f1_hz=None)
    for file in result_files(session):
        try:
            results = read_results(file)
        except RecordingError as error:
            notes.append(_said(error))
            continue
        k1, k2 = results.springs_n_per_m
        f1 = [load.f1_hz.value for load in results.loads if load.f1_hz is not None]
        entry = replace(
            entry,
            answer=plain_path(file, session),
            loads=results.loads,
            drifted=results.drifted,
            k1_n_per_m=entry.k1_n_per_m if k1 is None else k1,
            k2_n_per_m=entry.k2_n_per_m if k2 is None else k2,
            slope_mv_per_mn=entry.slope_mv_per_mn if results.slope_mv_per_mn is None else results.slope_mv_per_mn,
            zero_mv=entry.zero_mv if results.zero_mv is None else results.zero_mv,
            f1_hz=float(np.median(f1)) if f1 else None,
        )
        break
    else:
        if not notes:
            notes.append(f"has no {RESULTS} yet: 'mesotap report' or 'mesotap reanalyze' makes one")
    entry = _with_diagnosis(session, entry, notes)
    return replace(entry, notes=tuple(notes))


def _with_diagnosis(session: Path, entry: Entry, notes: list[str]) -> Entry:
    for file in diagnosis_files(session):
        try:
            verdict, mechanisms, recordings = read_verdict(file)
        except RecordingError as error:
            notes.append(_said(error))
            continue
        if recordings and entry.sha256 not in recordings:
            if file.name == DIAGNOSIS and not session.is_dir():
                continue  # of another file of this folder
            notes.append(f"{file}: is the diagnosis of another recording than this one, and left out")
            continue
        return replace(entry, diagnosis=plain_path(file, session), verdict=verdict, mechanisms=mechanisms)
    return entry


def plain_path(file: Path, session: Path) -> str:
    """Return a file's path from the session's folder, or from the folder of a file that lies by itself."""
    root = session if session.is_dir() else session.parent
    return plain(str(file.relative_to(root)).encode("utf-8", "surrogateescape").decode("utf-8", "replace"))


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _said(error: Exception) -> str:
    text = str(error) if isinstance(error, RecordingError) else f"its header or journal is damaged ({error})"
    return plain(text.encode("utf-8", "surrogateescape").decode("utf-8", "replace"))
