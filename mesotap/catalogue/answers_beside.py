"""The answers beside a session: results and diagnosis, as the program wrote them, and which of several counts."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from daq.errors import RecordingError
from daq.regular import read_regular
from mesotap.answers.formats import RESULTS_FORMAT
from mesotap.catalogue.entry import Found, LoadEntry, MechanismEntry

RESULTS, DIAGNOSIS = "results.json", "diagnosis.json"
AGAIN = "reanalysis"
"""Folder beside a session that holds later analyses, a folder each."""

LARGEST_ANSWER = 64 * 2**20
MOST_LOADS, MOST_MECHANISMS = 10_000, 1000
ESTIMATES = tuple(f.name for f in fields(LoadEntry) if f.name not in ("load_set", "target_load_mn", "impacts_used"))
NAMED = 0.5
"""Probability from which on a mechanism of a diagnosis counts as named; below it another explanation is likelier."""


@dataclass(frozen=True, slots=True)
class Results:
    """What a results file says, as the catalogue holds it."""

    file: str
    loads: tuple[LoadEntry, ...]
    drifted: bool | None
    slope_mv_per_mn: float | None
    zero_mv: float | None
    springs_n_per_m: tuple[float | None, float | None]


def places_of_answers(session: Path) -> tuple[Path, Path]:
    """Return where a session's answers lie, and where later analyses of it do.

    ``session`` is a session's folder, or a session file that lies by itself.
    """
    if session.is_dir():
        return session, session / AGAIN
    return session.with_name(f"{session.stem}-report"), session.with_name(f"{session.stem}-{AGAIN}")


def result_files(session: Path) -> list[Path]:
    """Return the results files of a session, the one written last first."""
    beside, again = places_of_answers(session)
    wanted = [beside / RESULTS]
    if not session.is_dir():
        wanted += [session.with_name(f"{session.stem}.json"), session.with_name(f"{session.stem}.{RESULTS}")]
    with contextlib.suppress(OSError):
        wanted += [place / RESULTS for place in again.iterdir() if place.is_dir() and not place.is_symlink()]
    found = []
    for file in wanted:
        with contextlib.suppress(OSError):
            found.append((file.stat().st_mtime_ns, file.parent.name, file))
    return [file for _, _, file in sorted(found, reverse=True)]


def diagnosis_files(session: Path) -> list[Path]:
    """Return the diagnoses that may be of a session, the likeliest first."""
    beside, _ = places_of_answers(session)
    wanted = [beside / DIAGNOSIS]
    if not session.is_dir():
        wanted += [session.with_name(f"{session.stem}.{DIAGNOSIS}"), session.with_name(DIAGNOSIS)]
    return [file for file in wanted if file.is_file()]


def read_answer(file: Path, what: str) -> dict[str, Any]:
    """Return a JSON answer.

    Raises
    ------
    RecordingError
        It cannot be read, or is none.
    """
    try:
        answer = json.loads(read_regular(file, LARGEST_ANSWER, what))
    except (ValueError, RecursionError) as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(f"{file}: is not {what}") from error
    if not isinstance(answer, dict):
        raise RecordingError(f"{file}: is not {what}")
    return answer


def read_results(file: Path) -> Results:
    """Return what a results file says.

    Raises
    ------
    RecordingError
        It is none, or of a version that this program does not read.
    """
    what = "the results of a session"
    answer = read_answer(file, what)
    if answer.get("format") != RESULTS_FORMAT:
        raise RecordingError(f"{file}: is not {what}: its format is {answer.get('format')!r:.40}")
    if answer.get("version") != 1:
        raise RecordingError(f"{file}: is of version {answer.get('version')!r:.20}, this program reads 1")
    try:
        loads = tuple(_load(load) for load in answer["loads"][:MOST_LOADS])
        calibration = answer.get("calibration") or {}
        springs = [_value(spring) for spring in answer.get("springs_n_per_m") or ()]
        k1, k2 = springs if len(springs) == 2 else (None, None)
        drifted = calibration.get("drifted")
        return Results(
            str(file),
            loads,
            drifted if isinstance(drifted, bool) else None,
            _value(calibration.get("sensitivity_mv_per_mn")),
            _value(calibration.get("offset_mv")),
            (k1, k2),
        )
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise RecordingError(f"{file}: is not {what}") from error


def read_verdict(file: Path) -> tuple[str, tuple[MechanismEntry, ...], list[str]]:
    """Return verdict and mechanisms of a diagnosis, and the SHA-256 of each recording that it is of.

    Raises
    ------
    RecordingError
        It is none.
    """
    what = "a diagnosis"
    answer = read_answer(file, what)
    try:
        if answer["format"] != "mesotap-diagnosis":
            raise RecordingError(f"{file}: is not {what}")
        named = tuple(
            MechanismEntry(_text(m["id"]), _number(m["probability"]), _text(m["statement"]))
            for m in answer["mechanisms"][:MOST_MECHANISMS]
        )
        recordings = answer.get("recordings") or ()
        return _text(answer["verdict"]), named, [_text(r["sha256"]) for r in recordings if r.get("sha256")]
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(f"{file}: is not {what}") from error


def plain(text: str) -> str:
    """Return a text that a database can keep: half a character of a pair becomes a question mark."""
    return text.encode("utf-8", "replace").decode()


def _load(said: dict[str, Any]) -> LoadEntry:
    estimates: dict[str, Any] = {name: _found(said[name]) for name in ESTIMATES}
    target = said.get("target_load_mn")
    return LoadEntry(
        load_set=_count(said["load_set"]),
        target_load_mn=None if target is None else _number(target),
        impacts_used=_count(said["impacts_used"]),
        **estimates,
    )


def _found(said: Any) -> Found | None:
    return None if said is None else Found(*_numbers(said))


def _numbers(said: dict[str, Any]) -> Iterator[float]:
    return (_number(said[key]) for key in ("value", "low", "high"))


def _value(said: Any) -> float | None:
    return None if said is None else _number(said["value"])


def _number(said: Any) -> float:
    if isinstance(said, bool) or not isinstance(said, int | float) or not math.isfinite(said):
        raise ValueError("a number was expected")
    return float(said)


def _count(said: Any) -> int:
    if isinstance(said, bool) or not isinstance(said, int) or not 0 <= said < 2**31:
        raise ValueError("a count was expected")
    return said


def _text(said: Any) -> str:
    if not isinstance(said, str):
        raise TypeError("a text was expected")
    return plain(said)
