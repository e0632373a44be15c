"""`mesotap crate`: sessions with everything that is needed to check them, for others."""

from __future__ import annotations

import datetime
import json
import os
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from daq.durable import PART, make_folder, write_error, write_whole
from daq.errors import RecordingError, UnwrittenError
from daq.journal import HEADER
from daq.limited import LimitedReader
from daq.regular import read_regular
from daq.session_file import KINDS, session_in
from mesotap.answers.rounding import counted
from mesotap.catalogue.crate import METADATA, Packed, contents, packed
from mesotap.catalogue.entry import UNREADABLE, Entry
from mesotap.catalogue.folders import LARGEST_HEADER
from mesotap.catalogue.indexing import sessions_within
from mesotap.catalogue.listing import copies
from mesotap.catalogue.reading import SESSION_FILE, entry_of
from mesotap.commands.catalog import Asked, look_up
from mesotap.commands.outputs import write_json
from mesotap.operator.terminal import escape

LARGEST_MB = 4000
"""Of all files of a crate, which are held in memory at once: a session of a day has 50."""


def crate(
    sessions: Sequence[Path], what: Asked, output: Path, licence: str, json_path: Path | None, console: Console
) -> None:
    """Write an RO-Crate of sessions that are named, or of those in the catalogue that are asked for."""
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise RecordingError(f"{output}: exists already and is left as it is; name a new folder")
    entries = _named(sessions) if sessions else look_up(what, console).found
    if not entries:
        raise RecordingError("no session is what was asked for, so that there is nothing to write")
    for entry in entries:
        if entry.state in UNREADABLE:
            raise RecordingError(f"{entry.path}: is {entry.state}: {entry.reason}; ask for others ('-state:...')")
    twice = copies(entries)
    for path, other in twice.items():
        console.print(f"- {escape(path)}: is a copy of {escape(other)} and left out", highlight=False, soft_wrap=True)
    entries = [entry for entry in entries if entry.path not in twice]
    chosen = _packed(entries)
    size = sum(file.stat().st_size for one in chosen for file in one.files.values()) / 1e6
    if size > LARGEST_MB:
        raise RecordingError(
            f"these sessions have {size:.0f} MB, more than the {LARGEST_MB} of one crate: ask for fewer"
        )
    files = contents(chosen, licence, datetime.datetime.now(datetime.UTC))
    _write(output, files)
    said = f"{counted(len(chosen), 'session')}, {len(files)} files; {METADATA} describes them (RO-Crate 1.1)"
    console.print(f"{escape(output)}: {said}", highlight=False, soft_wrap=True)
    if not licence:
        console.print("- no licence is stated; --license gives one, an address or a sentence", highlight=False)
    written = {"written": str(output), "sessions": [one.entry.path for one in chosen], "files": sorted(files)}
    write_json(json_path, written)


def _named(sessions: Sequence[Path]) -> list[Entry]:
    found = []
    with LimitedReader() as reader:
        for path in sessions:
            if not path.exists():
                raise RecordingError(f"{path}: there is no such session")
            place = path.resolve()
            place = place.parent if place.name == SESSION_FILE else place
            is_session = next(sessions_within(place, []), None) == place
            entry = entry_of(place, reader) if is_session else None
            if entry is None:
                raise RecordingError(f"{path}: is not a session; folders of sessions are asked for with --in")
            found.append(entry)
    if len({entry.path for entry in found}) < len(found):
        raise RecordingError("one session is named twice")
    return found


def _packed(entries: Sequence[Entry]) -> list[Packed]:
    made, taken = [], set()
    with LimitedReader() as reader:
        for entry in entries:
            path = Path(entry.path)
            stem = re.sub(r"[^A-Za-z0-9._-]+", "-", path.name if path.is_dir() else path.stem).strip(".-") or "session"
            name = next(n for i in range(len(entries) + 1) if (n := stem if i == 0 else f"{stem}-{i}") not in taken)
            taken.add(name)
            made.append(packed(entry, _configuration(path, reader), name))
    return made


def _configuration(session: Path, reader: LimitedReader) -> str:
    recorded = session / SESSION_FILE if session.is_dir() else session
    if recorded.is_file():
        return reader.read(session_in, recorded, kinds=KINDS).config
    header = json.loads(read_regular(session / HEADER, LARGEST_HEADER, "a session's header"))
    return str(header["config"])


def _write(output: Path, files: dict[str, bytes]) -> None:
    """Write a folder whole or not at all: beside it, and renamed into place."""
    part = output.with_name(f"{output.name}.{os.getpid()}{PART}")
    try:
        for name, content in files.items():
            make_folder((part / name).parent)
            write_whole(part / name, content)
        if output.exists():
            output.rmdir()
        part.rename(output)
    except OSError as error:
        raise write_error(output, error) from error
    except UnwrittenError as error:
        raise UnwrittenError(output, error.cause) from error
    finally:
        if part.exists():
            shutil.rmtree(part, ignore_errors=True)
