"""Answers for programs, and what is never written over."""

from __future__ import annotations

import errno
import json
import os
import stat
import sys
from pathlib import Path
from typing import Any

from daq.durable import cause_of, make_folder, try_to_write, write_error, write_whole
from daq.errors import RecordingError, UnwrittenError
from daq.regular import read_head
from daq.session_file import read_session

DEVICE_FOLDERS = (Path("/dev"), Path("/dev/fd").resolve(), Path("/proc/self/fd").resolve())


def make_ready(file: Path | None, folder: Path | None) -> None:
    """Find out before anything is computed whether a file can be written, and make a folder that is asked for.

    Both are tried out: permissions do not tell everything.

    Raises
    ------
    UnwrittenError
        One of them cannot be written.
    """
    if file is not None and str(file) != "-" and not _takes_what_is_written(file):
        try_to_write(file)
    if folder is None:
        return
    try:
        make_folder(folder)
    except OSError as error:
        raise write_error(folder, error) from error
    try_to_write(folder / "index.html")


def write_json(path: Path | None, answer: Any) -> None:
    """Write an answer for programs to ``path`` (``-``: standard output), whole or not at all; None writes nothing."""
    if path is None:
        return
    text = json.dumps(answer, indent=1, allow_nan=False) + "\n"
    if str(path) != "-" and path.is_file() and read_head(path, 1) not in (b"", b"{", b"["):
        raise RecordingError(f"{path}: exists already and is not JSON; it is left as it is, name another file")
    if str(path) == "-":
        sys.stdout.write(text)
    elif _takes_what_is_written(path):
        _write_through(path, text.encode())
    else:
        write_whole(path, text.encode())


def _takes_what_is_written(path: Path) -> bool:
    """Return whether a path is a pipe or a device such as a terminal, which is written to and not replaced."""
    try:
        kind = path.stat().st_mode
    except (OSError, ValueError):
        return False
    if stat.S_ISSOCK(kind) or stat.S_ISBLK(kind):
        raise UnwrittenError(path, "it is a disk or a socket; name a file")
    if stat.S_ISREG(kind) and path.parent.resolve() in DEVICE_FOLDERS:
        raise UnwrittenError(path, "it is not a file of yours; name another, or - for standard output")
    return stat.S_ISFIFO(kind) or stat.S_ISCHR(kind)


def _write_through(path: Path, content: bytes) -> None:
    """Write to what takes it at once; a pipe that nobody reads is refused and not waited for."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        os.set_blocking(descriptor, True)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
    except BrokenPipeError as error:
        raise UnwrittenError(path, "the reader has closed it") from error
    except OSError as error:
        nobody = error.errno == errno.ENXIO
        raise UnwrittenError(path, "nobody reads from this pipe" if nobody else cause_of(error)) from error


def refuse_to_overwrite(path: Path) -> None:
    """Raise where a file is there that cannot be made again: anything but one imported or simulated ring-down."""
    if not path.exists() or (path.is_file() and path.stat().st_size == 0):
        return
    try:
        there = read_session(path)
    except RecordingError:
        there = None
    if there is None or there.pre is not None or there.refused or len(there.impacts) > 1:
        raise RecordingError(f"{path}: exists already and is left as it is; name another file")
