"""The sessions in the console's folder: found by listing it, named by ids that are no paths."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq.errors import RecordingError
from daq.journal import HEADER, JOURNAL
from daq.regular import read_regular
from mesotap.commands.recordings import SESSION_FILE
from mesotap.console.board import DIAGNOSIS, REPORT, session_id
from mesotap.session.hand_verdicts import IMPACT, accepted_in
from mesotap.session.progress import Progress, progress_of
from mesotap.session.states import State

LARGEST_HEADER, LARGEST_JOURNAL = 2**20, 64 * 2**20
LARGEST_RESULTS = 64 * 2**20
MOST_SESSIONS = 2000
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
    for path in sorted(root.iterdir(), key=lambda p: p.name, reverse=True)[:MOST_SESSIONS]:
        if path.is_symlink() or not path.is_dir():
            continue
        try:
            found.append(PastSession(path, _summary(path)))
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


def goes_on(progress: Progress) -> str:
    """Return in words where a session that has ended goes on when it is resumed."""
    if progress.state is State.DONE:
        return ""
    if progress.state in (State.APPROACH, State.SET_LOAD, State.LOCK, State.TAP):
        return f"goes on at step {progress.load_set + 1} of the load plan ({progress.state.value})"
    return f"goes on with {progress.state.value}"


def _summary(path: Path) -> dict[str, Any]:
    header = json.loads(read_regular(path / HEADER, LARGEST_HEADER, "a session's header"))
    lines = b""
    if (path / JOURNAL).exists():
        lines = read_regular(path / JOURNAL, LARGEST_JOURNAL, "a journal")
    events = [json.loads(line) for line in lines.split(b"\n") if line.startswith(b"{") and line.endswith(b"}")]
    progress = progress_of(events)
    names = _names(str(header["config"]))
    return {
        "id": session_id(path),
        "name": path.name,
        "created": str(header["created"]),
        "simulated": bool(header.get("simulated")),
        **names,
        "state": progress.state.value,
        "done": progress.state is State.DONE,
        "goes_on": goes_on(progress),
        "drifted": _has_drifted(path),
        "taps": sum(e["event"] == IMPACT for e in events),
        "accepted": len(accepted_in(events)),
        "report": (path / REPORT).is_file(),
        "diagnosis": (path / DIAGNOSIS).is_file(),
        "file": (path / SESSION_FILE).is_file(),
    }


def _names(config: str) -> dict[str, str]:
    """Specimen, title and operator of a session's configuration."""
    from mesotap.configuration.yaml_text import NOT_YAML, parsed

    try:
        section = (parsed(config)[1] or {}).get("mesotap", {})
        return {key: str(section.get(key, "")) for key in ("specimen", "title", "operator")}
    except NOT_YAML:
        return dict.fromkeys(("specimen", "title", "operator"), "")
