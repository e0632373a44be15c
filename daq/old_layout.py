"""A look at HDF5 files in the old layout, by a process that may die of it.

Files without checksums (superblock 0 and 1, symbol tables) can, when damaged, crash the HDF5 library or keep it in a
loop, or have it make room for gigabytes that are not there: no exception, the whole program is gone. So such a file,
which only other programs write, is first read by a forked process that does nothing else, with little more memory than
the file can need. What it survives, this program survives.
"""

from __future__ import annotations

import contextlib
import faulthandler
import mmap
import os
import resource
from collections.abc import Iterator
from pathlib import Path

import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"
SYMBOL_TABLE = b"SNOD"
FIRST_CHECKED = 2
"""Version of the superblock since which structures carry checksums."""

LONGEST_LOOK_S = 20
"""Processor time after which the library counts as caught in a loop."""

ROOM = 100_000_000
"""Bytes that the library may take for itself, besides some copies of the file and of the array that it reads."""

COPIES = 4
_NO_ROOM = "memory allocation failed"
"""What the library says where it gets no more."""


class _TooMuch(Exception):
    """The library wanted more memory than there can be data."""


def is_old(path: Path) -> bool:
    """Return whether an HDF5 file has structures without checksums; the superblock's version follows its signature."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        start = superblock(content)
        version = content[start + len(SIGNATURE) : start + len(SIGNATURE) + 1]
        return version < bytes([FIRST_CHECKED]) or content.find(SYMBOL_TABLE) >= 0


def superblock(content: mmap.mmap) -> int:
    """Return where the superblock begins (byte 0, 512, 1024, 2048, ...): addresses in the file count from there."""
    start = 0
    while content[start : start + len(SIGNATURE)] != SIGNATURE and start < len(content):
        start = start * 2 or 512
    return start


def survives(path: Path, largest: int) -> bool:
    """Return whether everything in a file can be read, or refused, without the library taking the process with it.

    Parameters
    ----------
    largest
        Values beyond which an array is not read here, for it will not be read later.
    """
    child = os.fork()
    if child == 0:
        status = 1
        try:
            # a crash report of the child would look like one of this program
            faulthandler.disable()
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_LOOK_S, LONGEST_LOOK_S))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            with _attempt():
                _read_everything(path, largest)
            status = 0
        finally:
            os._exit(status)
    status = os.waitpid(child, 0)[1]
    return os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0


@contextlib.contextmanager
def _attempt() -> Iterator[None]:
    """Pass over what cannot be read: whoever reads it next tells it."""
    try:
        yield
    except _TooMuch:
        raise
    except Exception as error:
        if isinstance(error, MemoryError) or _NO_ROOM in str(error):
            raise _TooMuch from error


def _read_everything(path: Path, largest: int) -> None:
    room = ROOM + COPIES * path.stat().st_size
    _limit(room)
    with h5py.File(path, "r") as file:
        pending: list[h5py.Group | h5py.Dataset] = [file]
        seen: set[int] = set()
        while pending:
            item = pending.pop()
            with _attempt():
                _read_item(item, largest, room)
            if isinstance(item, h5py.Group):
                with _attempt():
                    for name in item:
                        with _attempt():
                            inner = item[name]
                            address = h5py.h5o.get_info(inner.id).addr
                            if address not in seen:
                                seen.add(address)
                                pending.append(inner)


def _read_item(item: h5py.Group | h5py.Dataset, largest: int, room: int) -> None:
    for name in item.attrs:
        with _attempt():
            item.attrs[name]
    if isinstance(item, h5py.Dataset) and item.size is not None and item.size <= largest:
        _limit(room + COPIES * item.size * item.dtype.itemsize)
        try:
            item[()]
        finally:
            _limit(room)


def _limit(room: int) -> None:
    """Let this process grow by so many bytes, and no more."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = resource.getrlimit(resource.RLIMIT_AS)[1]
    wanted = pages * resource.getpagesize() + room
    resource.setrlimit(resource.RLIMIT_AS, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most))
