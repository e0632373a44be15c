"""Files that are whole or absent: written beside, synced, and renamed into place."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from daq.errors import UnwrittenError

PART = ".part"
"""Ending of a file that is not finished; nothing reads one."""

_EXISTS = "there is a file of that name by now, which is left as it is; name another"
_CAUSES = {
    errno.ENOSPC: "the disk is full; free some space and save again",
    errno.EDQUOT: "the disk quota is used up; free some space and save again",
    errno.EACCES: "there is no permission",
    errno.EPERM: "there is no permission",
    errno.EROFS: "the file system is read-only",
    errno.ENOENT: "the folder does not exist",
    errno.ENOTDIR: "a part of the path is a file, not a folder",
    errno.EISDIR: "there is a folder of that name",
    errno.ENAMETOOLONG: "the name is too long",
    errno.ELOOP: "a link stands there, which could lead anywhere; remove it",
    errno.EEXIST: "another program writes it at this moment; try again",
    errno.EMEDIUMTYPE: "what is there is not a regular file; remove it",
}


def write_error(path: Path, error: OSError) -> UnwrittenError:
    """Return the one-sentence error for a file that could not be written."""
    if error.errno == errno.ENOENT and path.parent.is_dir():
        return UnwrittenError(path, "no file can be made in this folder")
    return UnwrittenError(path, cause_of(error))


def try_to_write(path: Path) -> None:
    """Find out whether `write_whole` can write a file, and leave everything as it is.

    Raises
    ------
    UnwrittenError
        It cannot.
    """
    if path.name in ("", "..") or path.is_dir():
        raise UnwrittenError(path, "it is a folder; name a file")
    part = path.with_name(path.name + PART)
    try:
        os.close(open_plain(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
        part.unlink(missing_ok=True)
    except FileExistsError:
        return  # of a program that was killed, or that writes it at this moment: told when it is written
    except OSError as error:
        raise write_error(path, error) from error


def cause_of(error: OSError) -> str:
    """Return why, and what to do, in the operator's words where there are any."""
    if error.errno == errno.EFBIG and error.strerror == os.strerror(errno.EFBIG):
        return "it would grow beyond the largest file allowed here"
    if error.errno == errno.EEXIST and error.strerror == _EXISTS:
        return _EXISTS
    return _CAUSES.get(error.errno or 0) or error.strerror or str(error)


def sync_folder(folder: Path) -> None:
    """Have the folder's list of names on the disk (a rename is lost in a power cut otherwise)."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_folder(folder: Path) -> None:
    """Make a folder and the folders above it that are missing, each with its name on the disk on return.

    Raises
    ------
    OSError
        One of them cannot be made.
    """
    if folder.is_dir():
        return
    if folder.exists():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    make_folder(folder.parent)
    folder.mkdir(exist_ok=True)
    sync_folder(folder)
    sync_folder(folder.parent)


def open_plain(path: Path, flags: int) -> int:
    """Return a descriptor of a plain file; what is a link, a FIFO or a device is refused and not waited for.

    Raises
    ------
    OSError
        It cannot be opened; ``ELOOP`` for a link, ``EMEDIUMTYPE`` for anything else that is not a file.
    """
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o644)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EMEDIUMTYPE, os.strerror(errno.EMEDIUMTYPE), str(path))
    return descriptor


def read_plain(path: Path, largest: int) -> bytes:
    """Return the content of a plain file of at most ``largest`` bytes.

    Raises
    ------
    OSError
        It cannot be read; ``EFBIG`` where it is larger, without having been read.
    """
    with os.fdopen(open_plain(path, os.O_RDONLY), "rb") as file:
        refuse_large(file.fileno(), largest)
        return file.read(largest)


def refuse_large(descriptor: int, largest: int) -> None:
    """Raise ``EFBIG`` for a file of more than ``largest`` bytes."""
    if os.fstat(descriptor).st_size > largest:
        raise OSError(errno.EFBIG, f"it is larger than {largest >> 20} MB, which mesotap never writes")


def remove_part(part: Path) -> None:
    """Remove what an earlier program left half written.

    Raises
    ------
    OSError
        It cannot be removed, or it is a link (``ELOOP``), which nobody leaves there by accident.
    """
    if part.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(part))
    part.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes | memoryview, new: bool = False) -> None:
    """Write ``content`` to ``path`` such that a kill at any instant leaves the old file, the new one or none.

    Parameters
    ----------
    new
        Whether no file of that name may be there: of several programs that begin it at once, one succeeds.

    Raises
    ------
    UnwrittenError
        There is no name, or a file where there must be none, the disk is full, the place is not writable, there is no
        such folder, or a link stands where the unfinished file is to be: nothing is ever written through one.
    """
    if path.name in ("", ".."):
        raise UnwrittenError(path, "it is a folder; name a file")
    part = path.with_name(f"{path.name}.{os.getpid()}{PART}" if new else path.name + PART)
    try:
        remove_part(part)
        descriptor = open_plain(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
    except OSError as error:
        # what stands in the way is named; anything else concerns the file itself
        raise write_error(part if error.errno in (errno.ELOOP, errno.EISDIR) else path, error) from error
    try:
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            if new:
                _rename_to_new(part, path)
            else:
                part.replace(path)
        except OSError:
            part.unlink(missing_ok=True)
            raise
        sync_folder(path.parent)
    except OSError as error:
        raise write_error(path, error) from error


def _rename_to_new(part: Path, path: Path) -> None:
    """Give a file a name that no other has.

    Raises
    ------
    OSError
        ``EEXIST`` where one has it.
    """
    try:
        path.hardlink_to(part)
    except FileExistsError as error:
        raise FileExistsError(errno.EEXIST, _EXISTS) from error
    except OSError:  # a file system without a second name for a file: the name is taken first, the content follows
        try:
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644))
        except FileExistsError as error:
            raise FileExistsError(errno.EEXIST, _EXISTS) from error
        part.replace(path)
    else:
        part.unlink()
