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
from mesotap.session.progress import progress_of
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
    path = session.path / RESULTS
    if not path.is_file():
        return []
    try:
        loads = json.loads(read_regular(path, LARGEST_RESULTS, "results"))["loads"]
        return [
            {
                "target_mn": load["target_load_mn"],
                "load_mn": load["load_mn"]["value"],
                "k_c": load["contact_stiffness_n_per_m"],
                "zeta2": load["zeta2"],
            }
            for load in loads
            if load["load_mn"] and load["contact_stiffness_n_per_m"] and load["zeta2"]
        ]
    except (ValueError, KeyError, TypeError) as error:
        raise RecordingError(f"{path.name}: is not the results of a session") from error


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
