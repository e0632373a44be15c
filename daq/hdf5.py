"""Checked access to HDF5: every item that is missing or malformed becomes a sentence that names it.

Nothing in a file is believed before it was looked at: not a kind, a shape, a count or a type.
"""

from __future__ import annotations

import math
import mmap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.old_layout import is_old, superblock, survives

CHECKSUMMED = ("v108", "v110")
"""Bounds on the layout of files written here: readable since HDF5 1.8, and damage to their structure is noticed.

The library crashes or loops on damage to the structure of files in the older layout, which has no checksums; see
`daq.old_layout`.
"""

LARGEST_ARRAY = 100_000_000
"""Values in one array beyond which a file is not believed (an hour of two channels at 14 kHz)."""

LARGEST_COUNT = 2**53
"""Whole numbers beyond which floating-point numbers skip some."""

_HEAP = b"GCOL\x01"

_BROKEN = (
    OSError,
    RuntimeError,
    LookupError,
    ValueError,
    TypeError,
    AttributeError,
    ArithmeticError,
    MemoryError,
)


@contextmanager
def open_hdf5(path: Path) -> Iterator[Node]:
    """Open an HDF5 file for reading; yields its root.

    Raises
    ------
    RecordingError
        There is no such file, or it is no HDF5 file, or it is a damaged one.
    """
    damaged = "damaged or truncated"
    with reading(path, "", damaged):
        if not path.exists():
            raise RecordingError(f"{path}: there is no such file")
        if path.is_dir():
            raise RecordingError(f"{path}: is a folder, not a file")
        if path.stat().st_size == 0:
            raise RecordingError(f"{path}: the file is empty")
        with path.open("rb"):
            pass
        if not h5py.is_hdf5(path):
            raise RecordingError(f"{path}: is no HDF5 file")
        if not _heaps_are_sound(path) or (is_old(path) and not survives(path, LARGEST_ARRAY)):
            raise RecordingError(f"{path}: the file is {damaged}")
        file = h5py.File(path, "r")
    with reading(path, "", damaged), file:
        yield Node(path, "", file)


def _heaps_are_sound(path: Path) -> bool:
    """Walk the global heaps, where HDF5 keeps texts: a damaged one has the library loop for ever.

    A heap is the signature, version 1, three zeros and its size (8 bytes); then objects, each an index (2 bytes), a
    count of references (2), four zeros and a size (8), followed by the content, padded to 8. Object 0 is the rest,
    and its size counts its own header. The library does not look at the zeros. Where they are none, it is a damaged
    heap if anything in the file refers to it, and otherwise samples that happen to look like one.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        base = superblock(content)
        heap = content.find(_HEAP)
        while heap >= 0:
            if content[heap + len(_HEAP) : heap + 8].strip(b"\0"):
                if content.find((heap - base).to_bytes(8, "little", signed=True)) >= 0:
                    return False
            elif heap + 16 <= len(content):
                size = int.from_bytes(content[heap + 8 : heap + 16], "little")
                at, end = heap + 16, heap + size
                if not 16 <= size <= len(content) - heap:
                    return False
                while at + 16 <= end:
                    index = int.from_bytes(content[at : at + 2], "little")
                    length = int.from_bytes(content[at + 8 : at + 16], "little")
                    step = 16 + (length + 7) // 8 * 8 if index else length
                    if not 16 <= step <= end - at:
                        return False
                    at += step
            heap = content.find(_HEAP, heap + len(_HEAP))
    return True


@contextmanager
def reading(path: Path, item: str, what: str = "cannot be read") -> Iterator[None]:
    """Turn what the HDF5 library raises on damaged files into a sentence about ``item``."""
    try:
        yield
    except RecordingError:
        raise
    except PermissionError as error:
        raise RecordingError(f"{path}: there is no permission to read it") from error
    except _BROKEN as error:
        place = f"{item} {what}" if item else f"the file is {what}"
        raise RecordingError(f"{path}: {place}") from error


@dataclass(frozen=True, slots=True)
class Node:
    """A group or dataset of an open file, with the name its errors are told under."""

    path: Path
    name: str
    item: Any

    def error(self, what: str, name: str = "") -> RecordingError:
        """Return an error about this node, or about ``name`` below it."""
        place = "/".join(part for part in (self.name, name) if part)
        return RecordingError(f"{self.path}: {place or '/'}{what}")

    def child(self, name: str) -> Node | None:
        """Return the item ``name`` of this group, or None when there is none."""
        full = f"{self.name}/{name}"
        with reading(self.path, full):
            if name not in self.item:
                return None
            return Node(self.path, full, self.item[name])

    def group(self, name: str) -> Node | None:
        """Return the group ``name``, or None; an error if that name is something else."""
        child = self.child(name)
        if child is not None and not isinstance(child.item, h5py.Group):
            raise child.error(" is not a group")
        return child

    def need_group(self, name: str) -> Node:
        """Return the group ``name``; an error if it is missing."""
        child = self.group(name)
        if child is None:
            raise self.error(" is missing", name if self.name else f"/{name}")
        return child

    def names(self) -> list[str]:
        """Return the names in this group, sorted."""
        with reading(self.path, self.name or "/"):
            return sorted(str(name) for name in self.item)

    def values(self, name: str, shape: tuple[int | None, ...], floating: bool = False) -> NDArray[np.float64]:
        """Return dataset ``name`` as float64 (None in ``shape``: any length but zero), all of it finite.

        Channels of a (2, n) array are called A and B in errors, as everywhere.
        """
        child = self.child(name)
        if child is None:
            raise self.error(f"/{name} is missing")
        data = child.item
        if not isinstance(data, h5py.Dataset):
            raise child.error(" is not an array")
        wanted = (
            "("
            + ", ".join("n" if size is None else str(size) for size in shape)
            + ("," if len(shape) == 1 else "")
            + ")"
        )
        with reading(self.path, child.name):
            found, kind = data.shape, data.dtype.kind
        if kind not in ("f" if floating else "fiu"):
            raise child.error(f" is not an array of {'floating-point ' if floating else ''}numbers")
        if found is None or len(found) != len(shape):
            raise child.error(f" has shape {found}, expected {wanted}")
        if any(size not in (None, n) for size, n in zip(shape, found, strict=True)):
            raise child.error(f" has shape {found}, expected {wanted}")
        if 0 in found:
            raise child.error(" is empty")
        if math.prod(found) > LARGEST_ARRAY:
            raise child.error(f" claims shape {found}, more than this program takes")
        with reading(self.path, child.name), np.errstate(all="ignore"):
            array = np.ascontiguousarray(data[()], dtype=np.float64)
        refuse_non_finite(array, f"{self.path}: {child.name}")
        return array

    def attribute(self, name: str) -> Any:
        """Return an attribute as a plain Python value, None when there is none; one-element arrays count as scalars."""
        with reading(self.path, f"attribute {name} of {self.name or '/'}"):
            if name not in self.item.attrs:
                return None
            value = self.item.attrs[name]
            if isinstance(value, h5py.Empty):
                return "" if value.dtype.kind in "SUO" else math.nan
            if isinstance(value, np.ndarray) and value.size == 1:
                value = value.reshape(-1)[0]
            if isinstance(value, np.generic):
                value = value.item()
            if isinstance(value, bytes):
                value = value.decode("utf-8")
            return value

    def text(self, name: str) -> str:
        """Return a required string attribute."""
        value = self.attribute(name)
        if value is None:
            raise self._attribute_error(name, "is missing")
        if not isinstance(value, str):
            raise self._attribute_error(name, f"is not a text but {value!r:.40}")
        if not is_storable(value):
            raise self._attribute_error(name, "holds a character that is none in UTF-8")
        return value

    def flag(self, name: str) -> bool:
        """Return a required bool attribute; 0 and 1 will do, as programs without an HDF5 bool write them."""
        value = self.attribute(name)
        if value is None:
            raise self._attribute_error(name, "is missing")
        if isinstance(value, bool) or (isinstance(value, int) and value in (0, 1)):
            return bool(value)
        raise self._attribute_error(name, f"is neither true nor false but {value!r:.40}")

    def number(self, name: str, required: bool = True, above: float = -math.inf, least: float = -math.inf) -> float:
        """Return a number attribute, greater than ``above``, at least ``least``; NaN where unknown."""
        value = self.attribute(name)
        if value is None:
            if required:
                raise self._attribute_error(name, "is missing")
            return math.nan
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._attribute_error(name, f"is not a number but {value!r:.40}")
        number = float(value)
        if math.isinf(number):
            raise self._attribute_error(name, "is infinite")
        if number <= above or number < least:
            limit = f"above {above:g}" if above > -math.inf else f"at least {least:g}"
            raise self._attribute_error(name, f"is {number:g}, expected {limit}")
        return number

    def count(self, name: str, least: int = 0) -> int:
        """Return a required whole number of at least ``least``."""
        value = self.number(name)
        if not math.isfinite(value) or value != int(value):
            raise self._attribute_error(name, f"is {value:g}, expected a whole number")
        if not least <= value <= LARGEST_COUNT:
            limit = f"at least {least}" if value < least else f"at most {LARGEST_COUNT}"
            raise self._attribute_error(name, f"is {value:g}, expected {limit}")
        return int(value)

    def _attribute_error(self, name: str, what: str) -> RecordingError:
        return RecordingError(f"{self.path}: attribute {name} of {self.name or '/'} {what}")


def claims_too_much(node: Node) -> bool:
    """Return whether a scalar of variable length says it is longer than its file.

    A dataset holds such a value as its length (4 bytes) and where in the file it is; neither has a checksum. The
    library makes room for the length before it looks there, up to 4 GB, and fills it.
    """
    with reading(node.path, node.name):
        place = node.item.id.get_offset() if node.item.dtype.kind == "O" else None
        if place is None:
            return False
        with node.path.open("rb") as file:
            file.seek(place)
            return int.from_bytes(file.read(4), "little") > node.path.stat().st_size


def is_storable(text: str) -> bool:
    """Return whether HDF5 can keep a text: no zeros within, and all of it UTF-8."""
    try:
        return b"\0" not in text.encode()
    except UnicodeEncodeError:
        return False


def channel_label(channel: int, channels: int) -> str:
    """Return what a channel is called in errors: A and B for a pair, else its number from 0."""
    return "AB"[channel] if channels == 2 else str(channel)


def refuse_non_finite(array: NDArray[np.float64], where: str) -> None:
    """Raise an error that names the first NaN or infinity of a one- or two-dimensional array."""
    finite = np.isfinite(array)
    if finite.all():
        return
    place = tuple(int(i) for i in np.argwhere(~finite)[0])
    what = "a NaN" if np.isnan(array[place]) else "an infinite value"
    channel = f"channel {channel_label(place[0], len(array))}, " if array.ndim == 2 else ""
    raise RecordingError(f"{where} holds {what} at {channel}sample {place[-1]}")
