"""What a session that ended without a word to the console has left in its journal."""

from __future__ import annotations

import json
from pathlib import Path

from daq.journal_file import JOURNAL

APART = "the surfaces are apart"
END, SAFE = 1 << 16, b'"event": "safe"'
"""Bytes of the journal's end that are looked through, and what a line about the surfaces holds."""


def last_safe(folder: Path | None) -> str:
    """Return what a session's journal says of the surfaces at its end; empty if nothing."""
    try:
        lines = [] if folder is None else (folder / JOURNAL).read_bytes()[-END:].splitlines()
        found = [json.loads(line) for line in lines if SAFE in line]
        last = found[-1]
        return f"{last['reason']}; {'; '.join(last['troubles']) or APART}"
    except (OSError, ValueError, LookupError, TypeError):
        return ""
