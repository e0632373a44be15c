"""Answers for programs, and what is never written over."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from daq.durable import write_whole
from daq.errors import RecordingError
from daq.regular import read_head
from daq.session_file import read_session


def write_json(path: Path | None, answer: Any) -> None:
    """Write an answer for programs to ``path`` (``-``: standard output), whole or not at all; None writes nothing."""
    if path is None:
        return
    text = json.dumps(answer, indent=1, allow_nan=False) + "\n"
    if str(path) != "-" and path.is_file() and read_head(path, 1) not in (b"", b"{", b"["):
        raise RecordingError(f"{path}: exists already and is no JSON; it is left as it is, name another file")
    if str(path) == "-":
        sys.stdout.write(text)
        return
    write_whole(path, text.encode())


def refuse_to_overwrite(path: Path) -> None:
    """Raise where a file is there that cannot be made again: anything but one imported or simulated ring-down."""
    if not path.exists() or (path.is_file() and path.stat().st_size == 0):
        return
    try:
        there = read_session(path)
    except RecordingError:
        there = None
    if there is None or there.pre is not None or len(there.shots) > 1:
        raise RecordingError(f"{path}: exists already and is left as it is; name another file")
