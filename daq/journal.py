"""The running session on disk: a folder that is right whenever the program is killed.

``session.json``
    The header: what was asked for. Written once, whole. A folder without it holds no session.
``journal.jsonl``
    What was done, a line an event, each on the disk before the program goes on.
``impacts/00000.h5``
    A file an impact, complete or absent, with the checkpoint of the rig after it.
``lock``
    Held by the one program that works here; the system frees it when the program dies.
"""

from __future__ import annotations

import fcntl
import json
import logging
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py

from daq.durable import (
    PART,
    cause_of,
    make_folder,
    open_plain,
    read_plain,
    remove_part,
    sync_folder,
    write_error,
    write_whole,
)
from daq.errors import RecordingError, UnwrittenError
from daq.hdf5 import CHECKSUMMED, open_hdf5, reading
from daq.impact_group import check_impact, digest_of, read_impact, scalar_text, to_json, write_impact
from daq.journal_file import JOURNAL, LARGEST_TEXT, append_after_death, mend, open_journal, write_all
from daq.json_text import GivenTwice, parsed_once
from daq.limited import read_limited
from daq.limits import impact_room
from daq.records import Impact

__all__ = ["HEADER", "IMPACTS", "JOURNAL", "LOCK", "SessionFolder", "any_impact_in", "append_after_death"]

HEADER, IMPACTS, LOCK = "session.json", "shots", "lock"
LOG = logging.getLogger("mesotap.journal")
IMPACT = "shot"
"""The journal's event for an impact that was kept; its entry has ``number`` and ``digest``."""
IMPACT_FORMAT = "mesotap-shot"


class SessionFolder:
    """A session that runs, or that was stopped and goes on. Make one with `create` or `open`; close it at the end.

    Attributes
    ----------
    path
        The folder.
    header
        What `create` was given, as JSON types.
    """

    def __init__(self, path: Path, lock: int, header: dict[str, Any]) -> None:
        self.path = path
        self.header = header
        self._lock = lock
        self._journal, self._events, self._length = open_journal(path / JOURNAL)
        _remove_parts(path)

    @classmethod
    def create(cls, path: str | Path, header: dict[str, Any]) -> SessionFolder:
        """Begin a session in a new folder, or in one that was left before its header was written.

        Raises
        ------
        RecordingError
            The folder holds a session already, another program works in it, or it cannot be written.
        """
        path = Path(path)
        _not_linked(path / IMPACTS)
        try:
            make_folder(path / IMPACTS)
            sync_folder(path)  # also where a program that was killed at once had made it
            sync_folder(path.parent)
        except OSError as error:
            raise write_error(path, error) from error
        lock = _take_lock(path)
        try:
            if any((path / name).exists() for name in (HEADER, JOURNAL)) or any((path / IMPACTS).glob("*.h5")):
                raise RecordingError(f"{path}: holds a session already; resume it, or name another folder")
            content = to_json(header)
            write_whole(path / HEADER, content.encode() + b"\n")
            return cls(path, lock, json.loads(content))
        except BaseException:
            os.close(lock)
            raise

    @classmethod
    def open(cls, path: str | Path) -> SessionFolder:
        """Go on with a session: takes the lock, drops what a kill left half written.

        Raises
        ------
        RecordingError
            No session is there, another program works on it, or its header or journal is damaged.
        """
        path = Path(path)
        if not path.is_dir():
            raise RecordingError(f"{path}: there is no such session folder")
        if not (path / IMPACTS).is_dir() and not (path / HEADER).exists():
            raise RecordingError(f"{path}: is not a session folder: it holds no {HEADER}")
        _not_linked(path / IMPACTS)
        lock = _take_lock(path)
        try:
            return cls(path, lock, _read_header(path))
        except BaseException:
            os.close(lock)
            raise

    @property
    def lock_descriptor(self) -> int:
        """Descriptor of the folder's lock, for whoever is to hold it after this program."""
        return self._lock

    def append(self, event: dict[str, Any]) -> None:
        """Add an event (a dict of JSON types with a key ``event``) to the journal; it is on disk on return.

        Raises
        ------
        RecordingError
            The event is none, or the disk is full; the journal is then as it was before.
        """
        if "event" not in event:
            raise RecordingError(f"{self.path / JOURNAL}: an entry without the key 'event' was to be written")
        if os.fstat(self._journal).st_nlink == 0:
            raise UnwrittenError(self.path, "it was deleted while the session ran")
        content = to_json(event)
        line = content.encode() + b"\n"
        try:
            write_all(self._journal, line)
            os.fsync(self._journal)
        except OSError as error:
            os.ftruncate(self._journal, self._length)
            raise write_error(self.path / JOURNAL, error) from error
        self._length += len(line)
        self._events.append(json.loads(content))
        if LOG.isEnabledFor(logging.INFO):
            told = {key: value for key, value in event.items() if key not in ("event", "at", "rig")}
            LOG.info("%s %s", event["event"], to_json(told))

    def events(self) -> list[dict[str, Any]]:
        """Return all events in order, those of earlier runs included."""
        return list(self._events)

    def write_impact(self, impact: Impact, checkpoint: dict[str, Any]) -> None:
        """Keep an impact, and the rig's state after it; on disk on return, absent if killed before.

        Raises
        ------
        RecordingError
            The impact is malformed, one of its number exists, or the disk is full.
        """
        path = self._impact_path(impact.number)
        if path.exists():
            raise RecordingError(f"{path}: this impact was recorded already")
        check_impact(impact, str(path))
        try:
            with h5py.File("shot", "w", driver="core", backing_store=False, libver=CHECKSUMMED) as file:
                file.attrs["format"] = IMPACT_FORMAT
                file.attrs["number"] = impact.number
                write_impact(file.create_group("shot"), impact, compress=False)
                file.create_dataset("checkpoint", data=to_json(checkpoint), dtype=h5py.string_dtype())
                file.flush()
                image = file.id.get_file_image()
        except (ValueError, TypeError, RuntimeError, OSError) as error:
            raise RecordingError(f"{path}: the impact cannot be put into a file: {error}") from error
        write_whole(path, image)

    def impact_numbers(self) -> list[int]:
        """Return the numbers of all complete impacts, ascending."""
        try:
            names = [entry.stem for entry in (self.path / IMPACTS).iterdir() if entry.suffix == ".h5"]
        except OSError as error:
            raise RecordingError(f"{self.path / IMPACTS}: cannot be listed: {error.strerror}") from error
        return sorted(int(name) for name in names if name.isascii() and name.isdigit())

    def read_impact(self, number: int) -> tuple[Impact, dict[str, Any]]:
        """Return impact ``number`` and the checkpoint kept with it.

        Raises
        ------
        RecordingError
            There is no such impact, or its file is damaged.
        """
        path = _not_linked(self._impact_path(number))
        impact, state = read_limited(impact_in, path, number, kinds=(Impact,))
        self._check_noted(impact)
        return impact, state

    def impacts(self) -> list[Impact]:
        """Return all complete impacts in order; `RecordingError` names a damaged file."""
        paths = {number: _not_linked(self._impact_path(number)) for number in self.impact_numbers()}
        size = sum(path.stat().st_size for path in paths.values() if path.is_file())
        listed = [[number, str(path)] for number, path in paths.items()]
        impacts: list[Impact] = (
            read_limited(impacts_in, self.path, listed, kinds=(Impact,), size=size) if listed else []
        )
        for impact in impacts:
            self._check_noted(impact)
        return impacts

    def close(self) -> None:
        """Let go of the folder; harmless when called twice."""
        for name in ("_journal", "_lock"):
            descriptor = getattr(self, name)
            if descriptor >= 0:
                os.close(descriptor)
                setattr(self, name, -1)

    def __enter__(self) -> SessionFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check_noted(self, impact: Impact) -> None:
        """Hold an impact against what the journal says of it."""
        noted = self._noted_digest(impact.number)
        if noted and noted != digest_of(impact):
            raise RecordingError(
                f"{self._impact_path(impact.number)}: is not the impact {impact.number} that the journal lists: its "
                "digest does not agree; put that one back"
            )

    def _noted_digest(self, number: int) -> str:
        """Digest by the journal; empty where it has none."""
        noted = (e.get("digest") for e in self._events if e["event"] == IMPACT and e.get("number") == number)
        return next((digest for digest in noted if isinstance(digest, str)), "")

    def _impact_path(self, number: int) -> Path:
        return self.path / IMPACTS / f"{number:05d}.h5"


def impact_in(path: Path, number: int) -> tuple[Impact, dict[str, Any]]:
    """Return an impact and its checkpoint from a file that this process opens; see `SessionFolder.read_impact`."""
    with open_hdf5(path, impact_room) as root:
        if root.attribute("format") != IMPACT_FORMAT or root.count("number") != number:
            raise RecordingError(f"{path}: is not the file of impact {number}")
        checkpoint = root.child("checkpoint")
        if checkpoint is None:
            raise root.error(" is missing", "/checkpoint")
        with reading(path, "/checkpoint"):
            state = json.loads(scalar_text(checkpoint))
        if not isinstance(state, dict):
            raise checkpoint.error(" is not a JSON object")
        return read_impact(root.need_group("shot"), number), state


def any_impact_in(path: Path) -> Impact:
    """Return the impact, of whatever number, in a file that this process opens itself, without its checkpoint."""
    with open_hdf5(path, impact_room) as root:
        if root.attribute("format") != IMPACT_FORMAT:
            raise RecordingError(f"{path}: it is not an impact of a session")
        return read_impact(root.need_group("shot"), root.count("number"))


def impacts_in(folder: Path, listed: Sequence[tuple[int, str]]) -> list[Impact]:
    """Return impacts from files that this process opens itself, a number and a path each."""
    return [impact_in(Path(path), number)[0] for number, path in listed]


def _not_linked(path: Path) -> Path:
    """Return a path in a session's folder; a link there would have another place read, or written to."""
    if path.is_symlink():
        raise RecordingError(f"{path}: is a link to another place, which is not followed; put there what it leads to")
    return path


def _take_lock(path: Path) -> int:
    try:
        descriptor = open_plain(path / LOCK, os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise write_error(path / LOCK, error) from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        raise RecordingError(f"{path}: another program works on this session; end it first") from error
    return descriptor


def _read_header(path: Path) -> dict[str, Any]:
    file = path / HEADER
    try:
        header = parsed_once(read_plain(file, LARGEST_TEXT))
    except GivenTwice as error:
        raise RecordingError(f"{file}: is damaged: {error}; {mend(path)}") from error
    except FileNotFoundError:
        if any((path / IMPACTS).glob("*.h5")):
            raise RecordingError(f"{path}: its {HEADER} is lost, but there are impacts; {mend(path)}") from None
        raise RecordingError(
            f"{path}: holds no session: it was stopped before it began; start it again with mesotap run"
        ) from None
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {cause_of(error)}") from error
    except (ValueError, RecursionError):
        header = None
    if not isinstance(header, dict):
        raise RecordingError(f"{file}: is damaged: it is not a JSON object; {mend(path)}")
    return header


def _remove_parts(path: Path) -> None:
    for folder in (path, path / IMPACTS):
        for part in folder.glob(f"*{PART}"):
            try:
                remove_part(part)
            except OSError as error:
                raise write_error(part, error) from error
