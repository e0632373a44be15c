"""A session's folder as it is listed: what it is called, where it stands, what there is to look at.

Header and journal tell that. They are read without the session's lock, so that a running session is listed too.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from daq.journal import HEADER, JOURNAL
from daq.regular import read_regular
from mesotap.configuration.yaml_text import NOT_YAML, parsed
from mesotap.session.hand_verdicts import IMPACT, accepted_in
from mesotap.session.progress import Progress, progress_of
from mesotap.session.states import State

LARGEST_HEADER, LARGEST_JOURNAL = 2**20, 64 * 2**20
NAMES = ("specimen", "title", "operator")


def goes_on(progress: Progress) -> str:
    """Return in words where a session that has ended goes on when it is resumed."""
    if progress.state is State.DONE:
        return ""
    if progress.state in (State.APPROACH, State.SET_LOAD, State.LOCK, State.TAP):
        return f"goes on at step {progress.load_set + 1} of the load plan ({progress.state.value})"
    return f"goes on with {progress.state.value}"


def read_folder(path: Path) -> dict[str, Any]:
    """Return how the session in a folder stands, as its header and journal say.

    Raises
    ------
    RecordingError, ValueError, LookupError, TypeError
        There is no session, or its header or journal is damaged.
    """
    header = json.loads(read_regular(path / HEADER, LARGEST_HEADER, "a session's header"))
    lines = b""
    if (path / JOURNAL).exists():
        lines = read_regular(path / JOURNAL, LARGEST_JOURNAL, "a journal")
    events = [json.loads(line) for line in lines.split(b"\n") if line.startswith(b"{") and line.endswith(b"}")]
    progress = progress_of(events)
    return {
        "created": str(header["created"]),
        "simulated": bool(header.get("simulated")),
        "software": str(header.get("software", "")),
        **names_in(str(header["config"])),
        "state": progress.state.value,
        "done": progress.state is State.DONE,
        "goes_on": goes_on(progress),
        "taps": sum(e["event"] == IMPACT for e in events),
        "accepted": len(accepted_in(events)),
    }


def names_in(config: str) -> dict[str, str]:
    """Return specimen, title and operator of a session's configuration."""
    try:
        section = (parsed(config)[1] or {}).get("mesotap", {})
        return {key: str(section.get(key, "")) for key in NAMES}
    except (*NOT_YAML, AttributeError):
        return dict.fromkeys(NAMES, "")
