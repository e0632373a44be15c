"""Files that somebody names are opened only where they are files: no pipe, no device, nothing that never ends."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from daq.errors import RecordingError

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)

_UNSIZED = 1_000_000  # bytes that are read of a file that says it is smaller, as those of /proc do


def open_regular(path: Path) -> tuple[int, int]:
    """Open a file for reading; return its descriptor and its size in bytes.

    It is looked at before it is opened, for opening alone waits at a pipe and acts on some devices, and once more
    after, for it may have been replaced in between.

    Raises
    ------
    RecordingError
        There is none, it is no file, or it may not be read.
    """
    try:
        _refuse_others(path, path.stat().st_mode)
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        try:
            status = os.fstat(descriptor)
            _refuse_others(path, status.st_mode)
        except BaseException:
            os.close(descriptor)
            raise
    except RecordingError:
        raise
    except FileNotFoundError:
        dangling = ": it is a link to nowhere" if path.is_symlink() else ""
        raise RecordingError(f"{path}: there is no such file{dangling}") from None
    except PermissionError:
        raise RecordingError(f"{path}: cannot be read: there is no permission to read it") from None
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    return descriptor, status.st_size


def read_regular(path: Path, most: int, what: str = "what is expected here") -> bytes:
    """Return what a file holds.

    Parameters
    ----------
    most
        Bytes beyond which it is not ``what``.

    Raises
    ------
    RecordingError
        It cannot be opened or read, or is larger.
    """
    descriptor, size = open_regular(path)
    try:
        with os.fdopen(descriptor, "rb") as file:
            content: bytes | None = b"" if size > most else file.read(min(most, max(size, _UNSIZED)) + 1)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    # what only looks like a file, such as the log of the kernel, may have nothing to give now, or more than it says
    if content is None or (size == 0 and content):
        raise RecordingError(f"{path}: cannot be read: it is not a regular file")
    if max(size, len(content)) > most:
        raise RecordingError(f"{path}: is larger than {_readable(most)}, too large for {what}")
    return content


def read_head(path: Path, most: int) -> bytes:
    """Return the first bytes of a file, ``most`` at the most; raises as `read_regular`."""
    descriptor, _ = open_regular(path)
    try:
        return os.read(descriptor, most)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    finally:
        os.close(descriptor)


def _refuse_others(path: Path, mode: int) -> None:
    if stat.S_ISREG(mode):
        return
    kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "something else")
    raise RecordingError(f"{path}: is {kind}, not a file")


def _readable(size: int) -> str:
    return f"{size // 10**6} MB" if size >= 10**6 else f"{size // 1000} kB"
