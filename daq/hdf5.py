"""Checked access to HDF5: every item that is missing or malformed becomes a sentence that names it.

Nothing in a file is believed before it was looked at: not a kind, a shape, a count or a type. Only what is in the file
itself is read, and each thing once: no link to another place, no array that is kept in another file or made of others.
What is made of damage inside of the library is the business of `daq.limited`: all this runs in a process of its own.
"""

from __future__ import annotations

import math
import mmap
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from daq.bounds import BOUNDS
from daq.errors import RecordingError, StructureError
from daq.limited_child import no_more_files
from daq.limits import LARGEST_ARRAY, data_room
from daq.regular import open_regular
from daq.texts import is_storable

CHECKSUMMED = ("v108", "v110")
"""Bounds on the layout of files written here: readable since HDF5 1.8, and damage to their structure is noticed."""

LARGEST_COUNT = 2**53
"""Whole numbers beyond which floating-point numbers skip some."""

MOST_NAMES = 100_000
"""Items of one group beyond which a file is not a recording: five digits number the impacts of a session."""

LARGEST_ATTRIBUTE = 1_000_000
"""Bytes of one attribute; HDF5 keeps up to 64 kB of it beside its item."""

SIGNATURE = b"\x89HDF\r\n\x1a\n"
FILTERS = {
    h5py.h5z.FILTER_DEFLATE: "gzip",
    h5py.h5z.FILTER_SHUFFLE: "shuffle",
    h5py.h5z.FILTER_FLETCHER32: "fletcher32",
    h5py.h5z.FILTER_SZIP: "szip",
    h5py.h5z.FILTER_LZF: "lzf",
}
"""What samples may have been packed with: each once, for twice packed is a millionth."""

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


@dataclass(slots=True)
class _Ledger:
    """What was read of a file so far: the bytes that it may still hold, and the addresses of what was taken."""

    size: int
    room: int
    taken: set[int] = field(default_factory=set)


@contextmanager
def open_hdf5(path: Path, room: Callable[[int], int] = data_room) -> Iterator[Node]:
    """Open an HDF5 file for reading; yields its root. Nothing else can be opened until it is closed.

    Parameters
    ----------
    room
        Bytes of arrays that a file of so many bytes may hold.

    Raises
    ------
    RecordingError
        There is no such file, or it is not an HDF5 file, or it is a damaged one.
    """
    damaged = "damaged or truncated"
    descriptor, size = open_regular(path)
    try:
        if not size:
            raise RecordingError(f"{path}: the file is empty")
        same = f"/proc/self/fd/{descriptor}"  # what was looked at, whatever has the name by now
        with reading(path, "", damaged):
            if not h5py.is_hdf5(same):
                raise RecordingError(f"{path}: is not an HDF5 file")
            if not _heaps_are_sound(descriptor):
                raise RecordingError(f"{path}: the file is {damaged}")
            file = h5py.File(same, "r")
        with reading(path, "", damaged), file, no_more_files():
            yield Node(path, "", file, _Ledger(size, room(size)))
    finally:
        os.close(descriptor)


def superblock(content: mmap.mmap) -> int:
    """Return where the superblock begins (byte 0, 512, 1024, 2048, ...): addresses in the file count from there."""
    start = 0
    while content[start : start + len(SIGNATURE)] != SIGNATURE and start < len(content):
        start = start * 2 or 512
    return start


def _heaps_are_sound(descriptor: int) -> bool:
    """Walk the global heaps, where HDF5 keeps texts: a damaged one has the library loop for ever.

    A heap is the signature, version 1, three zeros and its size (8 bytes); then objects, each an index (2 bytes), a
    count of references (2), four zeros and a size (8), followed by the content, padded to 8. Object 0 is the rest,
    and its size counts its own header. The library does not look at the zeros. Where they are none, it is a damaged
    heap if anything in the file refers to it, and otherwise samples that happen to look like one.
    """
    with mmap.mmap(descriptor, 0, access=mmap.ACCESS_READ) as content:
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
    ledger: _Ledger = field(default_factory=lambda: _Ledger(0, data_room(0)), compare=False)

    def error(self, what: str, name: str = "") -> RecordingError:
        """Return an error about this node, or about ``name`` below it."""
        place = "/".join(part for part in (self.name, name) if part)
        return RecordingError(f"{self.path}: {place or '/'}{what}")

    def unsound(self, what: str) -> StructureError:
        """Return an error about how this item is kept, which has the whole file in doubt."""
        return StructureError(str(self.error(what)))

    def child(self, name: str) -> Node | None:
        """Return the item ``name`` of this group, or None when there is none; an error if it is a link elsewhere."""
        full = f"{self.name}/{name}"
        with reading(self.path, full):
            if not self.item.id.links.exists(name.encode("utf-8", "surrogateescape")):
                return None
        if self.is_link(name):
            raise StructureError(f"{self.path}: {full} is a link to another place, which is not followed")
        with reading(self.path, full):
            return Node(self.path, full, self.item[name], self.ledger)

    def is_link(self, name: str) -> bool:
        """Return whether an item is a link to another place, in this file or another."""
        with reading(self.path, f"{self.name}/{name}"):
            link = name.encode("utf-8", "surrogateescape")
            return bool(self.item.id.links.get_info(link).type != h5py.h5l.TYPE_HARD)

    def is_taken(self) -> bool:
        """Return whether this item was read before, under another name."""
        with reading(self.path, self.name or "/"):
            return int(h5py.h5o.get_info(self.item.id).addr) in self.ledger.taken

    def take(self) -> None:
        """Note that this item is read.

        Raises
        ------
        RecordingError
            It was read before, under another name: hard links make one array a thousand, or a group its own child.
        """
        if self.is_taken():
            raise self.unsound(" is the same as another item")
        self.ledger.taken.add(int(h5py.h5o.get_info(self.item.id).addr))

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
            if len(self.item) > MOST_NAMES:
                raise self.error(f" holds {len(self.item)} items, more than this program takes")
            return sorted(str(name) for name in self.item)

    def values(self, name: str, shape: tuple[int | None, ...], floating: bool = False) -> NDArray[np.float64]:
        """Return dataset ``name`` as float64 (None in ``shape``: any length but zero), all of it finite.

        Channels of a (2, n) array are called A and B in errors, as everywhere.
        """
        child = self.child(name)
        if child is None:
            raise self.error(f"/{name} is missing")
        if not isinstance(child.item, h5py.Dataset):
            raise child.error(" is not an array")
        child.refuse_layout()
        data = child.item
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
        with reading(self.path, child.name), np.errstate(all="ignore"):
            array = np.ascontiguousarray(child.content(), dtype=np.float64)
        refuse_non_finite(array, f"{self.path}: {child.name}")
        if name in BOUNDS and (fault := BOUNDS[name].fault_of_all(array)):
            raise child.error(f" {fault}")
        return array

    def refuse_layout(self) -> None:
        """Refuse an array that is kept elsewhere, made of others, or packed by what is not known.

        Raises
        ------
        RecordingError
            Says which; it is a `StructureError`.
        """
        with reading(self.path, self.name):
            plan = self.item.id.get_create_plist()
            layout = plan.get_layout()
            elsewhere = layout != h5py.h5d.VIRTUAL and plan.get_external_count() > 0
            packing = [plan.get_filter(i)[0] for i in range(plan.get_nfilters())]
        if layout == h5py.h5d.VIRTUAL:
            raise self.unsound(" is made of other arrays, which are not read")
        if elsewhere:
            raise self.unsound(" is kept in another file, which is not read")
        unknown = next((code for code in packing if code not in FILTERS), None)
        if unknown is not None:
            raise self.unsound(f" is packed by filter {unknown}; known are {', '.join(FILTERS.values())}")
        if len(set(packing)) < len(packing):
            raise self.unsound(" is packed twice")

    def content(self) -> NDArray[np.generic]:
        """Return this array as it is, once its claims were held against what its file can hold.

        Raises
        ------
        RecordingError
            It claims more, or was read before.
        """
        self.refuse_layout()
        self.take()
        with reading(self.path, self.name):
            shape, itemsize = self.item.shape, self.item.dtype.itemsize
            chunk = math.prod(self.item.chunks or ())
            stored = int(self.item.id.get_storage_size())
        if math.prod(shape) > LARGEST_ARRAY:
            raise self.unsound(f" claims shape {shape}, more than this program takes")
        needed = max(math.prod(shape) * max(itemsize, 8), chunk * itemsize)
        if needed > self.ledger.room or stored > self.ledger.size:
            raise self.unsound(f" claims shape {shape}, more than a file of this size holds")
        self.ledger.room -= needed
        with reading(self.path, self.name), np.errstate(all="ignore"):
            return np.asarray(self.item[()])

    def attribute(self, name: str) -> Any:
        """Return an attribute as a plain Python value, None when there is none; one-element arrays count as scalars."""
        with reading(self.path, f"attribute {name} of {self.name or '/'}"):
            if name not in self.item.attrs:
                return None
            kept = self.item.attrs.get_id(name)
            if math.prod(kept.shape or ()) * kept.dtype.itemsize > LARGEST_ATTRIBUTE:
                raise self._attribute_error(name, "is longer than this program takes")
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
            raise self._attribute_error(name, f"is not text but {value!r:.40}")
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
        number = _as_float(value)
        if math.isinf(number):
            raise self._attribute_error(name, "is infinite")
        if number <= above or number < least:
            limit = f"above {above:g}" if above > -math.inf else f"at least {least:g}"
            raise self._attribute_error(name, f"is {number:g}, expected {limit}")
        if name in BOUNDS and (fault := BOUNDS[name].fault(number)):
            raise self._attribute_error(name, fault)
        return number

    def count(self, name: str, least: int = 0, most: int = LARGEST_COUNT) -> int:
        """Return a required whole number of at least ``least`` and at most ``most``."""
        value = self.number(name)
        if not math.isfinite(value) or value != int(value):
            raise self._attribute_error(name, f"is {value:g}, expected a whole number")
        if not least <= value <= most:
            limit = f"at least {least}" if value < least else f"at most {most}"
            raise self._attribute_error(name, f"is {value:g}, expected {limit}")
        return int(value)

    def _attribute_error(self, name: str, what: str) -> RecordingError:
        return RecordingError(f"{self.path}: attribute {name} of {self.name or '/'} {what}")


def _as_float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def claims_too_much(node: Node) -> bool:
    """Return whether a scalar of variable length says it is longer than its file.

    A dataset holds such a value as its length (4 bytes) and where in the file it is; neither has a checksum. The
    library makes room for the length before it looks there, up to 4 GB, and fills it.
    """
    with reading(node.path, node.name):
        place = node.item.id.get_offset() if node.item.dtype.kind == "O" else None
        if place is None:
            return False
        descriptor = int(node.item.file.id.get_vfd_handle())
        return int.from_bytes(os.pread(descriptor, 4, place), "little") > node.ledger.size


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
