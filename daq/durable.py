"""Files that are whole or absent: written beside, synced, and renamed into place."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from daq.errors import UnwrittenError

PART = ".part"
"""Ending of a file that is not finished; nothing reads one."""

_CAUSES = {
    errno.ENOSPC: "the disk is full; free some space and save again",
    errno.EDQUOT: "the disk quota is used up; free some space and save again",
    errno.EFBIG: "it would grow beyond the largest file allowed here",
    errno.EACCES: "there is no permission to write here",
    errno.EPERM: "there is no permission to write here",
    errno.EROFS: "the file system is read-only",
    errno.ENOENT: "the folder does not exist",
    errno.ENOTDIR: "a part of the path is a file, not a folder",
    errno.EISDIR: "there is a folder of that name",
    errno.ENAMETOOLONG: "the name is too long",
}


def write_error(path: Path, error: OSError) -> UnwrittenError:
    """Return the one-sentence error for a file that could not be written."""
    cause = _CAUSES.get(error.errno or 0) or error.strerror or str(error)
    return UnwrittenError(path, cause)


def sync_folder(folder: Path) -> None:
    """Have the folder's list of names on the disk (a rename is lost in a power cut otherwise)."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_whole(path: Path, content: bytes | memoryview) -> None:
    """Write ``content`` to ``path`` such that a kill at any instant leaves the old file, the new one or none.

    Raises
    ------
    UnwrittenError
        The disk is full, the place is not writable, or there is no such folder.
    """
    part = path.with_name(path.name + PART)
    try:
        try:
            with part.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        except OSError:
            if part.is_file():
                part.unlink()
            raise
        sync_folder(path.parent)
    except OSError as error:
        raise write_error(path, error) from error
