"""The sessions in the console's folder: found by listing it, named by ids that are no paths."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq.errors import RecordingError
from daq.journal import HEADER
from daq.regular import read_regular
from mesotap.catalogue.entry import Entry
from mesotap.catalogue.folders import LARGEST_HEADER, read_folder
from mesotap.catalogue.known import catalogued
from mesotap.commands.recordings import SESSION_FILE
from mesotap.console.board import DIAGNOSIS, REPORT, session_id
from mesotap.session.header import kept_config
from mesotap.session.states import State

LARGEST_RESULTS = 64 * 2**20
MOST_SESSIONS = 2000
MOST_COMPARED = 4
RESULTS = "results.json"


@dataclass(frozen=True, slots=True)
class PastSession:
    """A session folder, as it is listed.

    Attributes
    ----------
    path
        Never told to a page.
    summary
        What is: id, name, specimen, title, operator, created, state, taps, and what there is to look at.
    """

    path: Path
    summary: dict[str, Any]


def sessions_in(root: Path) -> list[PastSession]:
    """Return the sessions of a folder, the newest first; what is no session, or a link, is left out."""
    if not root.is_dir():
        return []
    found = []
    with catalogued() as entry_at:
        for path in sorted(root.iterdir(), key=lambda p: p.name, reverse=True)[:MOST_SESSIONS]:
            if path.is_symlink() or not path.is_dir():
                continue
            try:
                found.append(PastSession(path, _summary(path, entry_at(path))))
            except (RecordingError, ValueError, KeyError, TypeError, LookupError, OSError):
                continue  # no session, or one that 'mesotap recover' is for
    return sorted(found, key=lambda s: s.summary["created"], reverse=True)


def session_of(root: Path, wanted: str) -> PastSession | None:
    """Return the session of an id."""
    return next((s for s in sessions_in(root) if s.summary["id"] == wanted), None)


def results_of(session: PastSession) -> list[dict[str, Any]]:
    """Return load and k_c of each load of a finished session, from its results; none where there are none.

    Raises
    ------
    RecordingError
        The results cannot be read.
    """
    results = _read_results(session.path)
    if results is None:
        return []
    try:
        return [
            {
                "target_mn": load["target_load_mn"],
                "load_mn": load["load_mn"]["value"],
                "load_half_mn": (load["load_mn"]["high"] - load["load_mn"]["low"]) / 2,
                "k_c": load["contact_stiffness_n_per_m"],
                "zeta2": load["zeta2"],
            }
            for load in results["loads"]
            if load["load_mn"] and load["contact_stiffness_n_per_m"] and load["zeta2"]
        ]
    except (ValueError, KeyError, TypeError) as error:
        raise RecordingError(f"{RESULTS}: is not the results of a session") from error


def comparison_of(sessions: Sequence[PastSession]) -> dict[str, Any]:
    """Return sessions held against each other, as `mesotap.catalogue.comparing` does.

    Raises
    ------
    MesotapError
        One of them has no results that tell what their uncertainty is made of.
    """
    from mesotap.catalogue.comparing import comparison_json  # the server is quick to start without the numerics
    from mesotap.catalogue.curves import read_compared

    told = []
    for session in sessions:
        header = json.loads(read_regular(session.path / HEADER, LARGEST_HEADER, "a session's header"))
        config = kept_config(str(header["config"]), str(session.path / HEADER)).config
        told.append(read_compared(session.path, config))
    return comparison_json(told)


def _read_results(path: Path) -> dict[str, Any] | None:
    """Results of the session in a folder; None where there are none yet."""
    file = path / RESULTS
    if not file.is_file():
        return None
    try:
        results = json.loads(read_regular(file, LARGEST_RESULTS, "results"))
    except ValueError as error:
        raise RecordingError(f"{RESULTS}: is not the results of a session") from error
    if not isinstance(results, dict):
        raise RecordingError(f"{RESULTS}: is not the results of a session")
    return results


def _has_drifted(path: Path) -> bool:
    """Whether the gauge is known to have drifted, so that every load of the session is in doubt."""
    try:
        calibration = (_read_results(path) or {}).get("calibration")
    except RecordingError:
        return False  # whoever opens or compares it is told
    return isinstance(calibration, dict) and calibration.get("drifted") is True


def _summary(path: Path, entry: Entry | None) -> dict[str, Any]:
    """What is said of a session: by the catalogue where it knows the folder as it is now, else by the folder itself."""
    told = {**_by_folder(path), "drifted": _has_drifted(path)} if entry is None else _told(entry)
    return {
        "id": session_id(path),
        "name": path.name,
        **told,
        "report": (path / REPORT).is_file(),
        "diagnosis": (path / DIAGNOSIS).is_file(),
        "file": (path / SESSION_FILE).is_file(),
    }


def _by_folder(path: Path) -> dict[str, Any]:
    return {key: said for key, said in read_folder(path).items() if key != "software"}


def _told(entry: Entry) -> dict[str, Any]:
    names = ("created", "simulated", "specimen", "title", "operator", "goes_on", "taps", "accepted")
    return {
        **{name: getattr(entry, name) for name in names},
        "state": entry.stands,
        "done": entry.stands == State.DONE.value,
        "drifted": entry.drifted is True,
        "verdict": entry.verdict,
        "mechanisms": [m.id for m in entry.mechanisms],
    }
