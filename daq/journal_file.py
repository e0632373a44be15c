"""The journal: a line of JSON an event, each on the disk before the program goes on.

Free of HDF5, so that a process that only has to note one event starts at once.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from daq.durable import open_plain, refuse_large, sync_folder, write_error
from daq.errors import RecordingError
from daq.json_text import GivenTwice, parsed_once

JOURNAL = "journal.jsonl"
LARGEST_TEXT = 64 * 2**20
"""Bytes of a journal or header beyond which it is none: a session of a day takes a thirtieth."""


def mend(folder: Path) -> str:
    """Return what to do about a session folder that is damaged."""
    return f"'mesotap recover {folder}' makes a session file of its intact impacts"


def open_journal(path: Path) -> tuple[int, list[dict[str, Any]], int]:
    """Return the journal's descriptor, its events, and its length in bytes after a torn tail was cut off."""
    try:
        if path.is_symlink():
            raise RecordingError(
                f"{path}: is a link to another place, which is not followed; put the file itself there"
            )
        new = not path.exists()
        descriptor = open_plain(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
    except OSError as error:
        raise write_error(path, error) from error
    try:
        refuse_large(descriptor, LARGEST_TEXT)
        content = _tail(descriptor)
        events, length = parse_journal(content, path)
        if length < len(content):
            os.ftruncate(descriptor, length)
            os.fsync(descriptor)
        if new:
            sync_folder(path.parent)
    except BaseException as error:
        os.close(descriptor)
        if isinstance(error, OSError):
            raise write_error(path, error) from error
        raise
    return descriptor, events, length


def append_after_death(folder: Path, event: dict[str, Any]) -> bool:
    """Add an event to the journal of a session whose program is dead; on disk on return.

    For a process that outlives the session. It takes no lock: whoever calls it has made sure that nobody else
    writes. A torn last line is cut off, as opening the session would do. Damage further up is left as it is.

    Parameters
    ----------
    folder
        The session's folder.
    event
        A dict of JSON types with a key ``event``.

    Returns
    -------
    bool
        Whether the event is in the journal. False where there is no such folder, no journal in it (nothing was
        begun that could be noted), the journal is a link or no file, or nothing can be written.

    Raises
    ------
    ValueError, TypeError
        The event is none: a fault of the program that calls.
    """
    if "event" not in event:
        raise ValueError("an entry without the key 'event' was to be written")
    line = json.dumps(event).encode() + b"\n"
    try:
        descriptor = open_plain(folder / JOURNAL, os.O_RDWR | os.O_APPEND)
    except OSError:
        return False
    try:
        tail = _tail(descriptor)
        length = os.fstat(descriptor).st_size - len(tail) + _whole_length(tail)
        os.ftruncate(descriptor, length)
        try:
            write_all(descriptor, line)
            os.fsync(descriptor)
        except OSError:
            os.ftruncate(descriptor, length)
            return False
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True


def parse_journal(content: bytes, path: Path) -> tuple[list[dict[str, Any]], int]:
    """Return the events in a journal and how many of its bytes they take; a torn last line is left out.

    A line counts once its line end is there. A last line that is not an event was cut off in a power failure
    (it was never reported as written) and is left out too.

    Raises
    ------
    RecordingError
        A line before the last one is not an event; its number is named.
    """
    lines = content.split(b"\n")[:-1]
    events: list[dict[str, Any]] = []
    length = 0
    for number, line in enumerate(lines, start=1):
        try:
            event = _parse_event(line)
        except GivenTwice as error:
            raise RecordingError(f"{path}: line {number} is damaged: {error}; {mend(path.parent)}") from error
        if event is None:
            if number == len(lines):
                break
            raise RecordingError(f"{path}: line {number} is damaged: it is not a journal entry; {mend(path.parent)}")
        events.append(event)
        length += len(line) + 1
    return events, length


def write_all(descriptor: int, content: bytes) -> None:
    """Write ``content`` to the end, however many calls that takes."""
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def _tail(descriptor: int) -> bytes:
    """Return the last `LARGEST_TEXT` bytes of a file: all of it, if it is a journal."""
    pieces = []
    at = max(0, os.fstat(descriptor).st_size - LARGEST_TEXT)
    while piece := os.pread(descriptor, 1 << 20, at):
        pieces.append(piece)
        at += len(piece)
    return b"".join(pieces)


def _whole_length(content: bytes) -> int:
    """Bytes up to where a torn last line begins."""
    end = content.rfind(b"\n") + 1
    last = content.rfind(b"\n", 0, max(end - 1, 0)) + 1
    try:
        return end if end == 0 or _parse_event(content[last : end - 1]) is not None else last
    except GivenTwice:  # not torn, but damaged: left as it is
        return end


def _parse_event(line: bytes) -> dict[str, Any] | None:
    try:
        event = parsed_once(line)
    except GivenTwice:
        raise
    except (ValueError, RecursionError):
        return None
    return event if isinstance(event, dict) and "event" in event else None
