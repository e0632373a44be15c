"""MAT files of version 5 (the default of MATLAB's ``save``): numeric arrays, texts, structs and cells.

Read here, not by scipy: its reader crashes or loops for minutes on damaged files. The layout is MathWorks'
"MAT-File Format": elements of a tag (type, size) and a content padded to 8 bytes; an array is an element that holds
elements: flags, dimensions, name, and its data.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.exchange.arrays import NamedArrays, sort_arrays
from daq.exchange.recording import Columns
from daq.limits import LARGEST_ARRAY

HEADER = 128
MATRIX, COMPRESSED = 14, 15
CELL, STRUCT, OBJECT, CHAR = 1, 2, 3, 4
NUMERIC = range(6, 16)
COMPLEX_FLAG = 0x0800
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}

DEEPEST = 8
"""Structs within structs beyond which nothing is looked for."""

MOST_ELEMENTS = 100_000
"""Elements of structs and cells beyond which a file is not taken for a recording."""

LARGEST_CONTENT = 8 * LARGEST_ARRAY
"""Bytes that one compressed variable may unpack to."""


class _Damaged(Exception):
    """Where the layout is broken; told to the user as one sentence about the file."""


@dataclass(slots=True)
class _Reader:
    """Steps through the elements in ``content``."""

    content: memoryview
    order: str  # "<" or ">"
    at: int = 0

    def more(self) -> bool:
        return self.at < len(self.content)

    def element(self) -> tuple[int, memoryview]:
        """Return type and content of the next element, and step over it."""
        if self.at + 8 > len(self.content):
            raise _Damaged
        first, second = np.frombuffer(self.content[self.at : self.at + 8], self.order + "u4").tolist()
        if first >> 16:  # a small element: size and type share a word, the content is in the tag
            kind, size, begin, step = first & 0xFFFF, first >> 16, self.at + 4, 8
            if size > 4:
                raise _Damaged
        else:
            kind, size, begin = first, second, self.at + 8
            step = 8 + (size if kind == COMPRESSED else (size + 7) // 8 * 8)
        if begin + size > len(self.content):
            raise _Damaged
        self.at += step
        return kind, self.content[begin : begin + size]

    def numbers(self) -> NDArray[np.generic]:
        """Return the next element as numbers."""
        kind, content = self.element()
        if kind not in _NUMBERS:
            raise _Damaged
        dtype = np.dtype(self.order + _NUMBERS[kind])
        if len(content) % dtype.itemsize:
            raise _Damaged
        return np.frombuffer(content, dtype)

    def text(self) -> str:
        """Return the next element as text; zeros at its end are padding."""
        kind, content = self.element()
        coding = _TEXTS.get(kind, "latin-1")
        if coding != "latin-1" and coding != "utf-8":
            coding += "-le" if self.order == "<" else "-be"
        return bytes(content).decode(coding, "replace").rstrip("\0")


def read_mat5(path: Path, content: bytes) -> Columns:
    """Return the channels in a MAT file of version 5.

    Raises
    ------
    RecordingError
        The file is damaged, of another version, or holds no array that could be a channel.
    """
    return sort_arrays(path, walk_mat5(path, content))


def walk_mat5(path: Path, content: bytes) -> NamedArrays:
    """Return all arrays in a MAT file of version 5, each under its dotted name.

    Raises
    ------
    RecordingError
        The file is damaged, or of another version.
    """
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if len(content) < HEADER or order is None:
        raise RecordingError(f"{path}: is damaged, truncated, or no MAT file of version 5 or 7.3")
    found = NamedArrays()
    try:
        reader = _Reader(memoryview(content), order, HEADER)
        for _ in range(MOST_ELEMENTS):
            if not reader.more():
                break
            kind, inner = reader.element()
            if not kind:
                raise _Damaged
            if kind == COMPRESSED:
                kind, inner = _Reader(_unpack(inner), order).element()
            if kind == MATRIX:
                _take(found, _Reader(inner, order), "", 0)
    except (_Damaged, zlib.error, ValueError, OverflowError) as error:
        raise RecordingError(f"{path}: is a damaged or truncated MAT file") from error
    return found


def _unpack(content: memoryview) -> memoryview:
    unpacker = zlib.decompressobj()
    unpacked = unpacker.decompress(content, LARGEST_CONTENT)
    if not unpacker.eof:
        raise _Damaged
    return memoryview(unpacked)


def _take(found: NamedArrays, reader: _Reader, name: str, depth: int) -> None:
    """Take in one array, and what is inside it; ``name`` is that of a field or cell, which hold none of their own."""
    if not reader.more():
        return
    flags = reader.numbers()
    if not flags.size:
        raise _Damaged
    word = int(flags[0])
    kind = word & 0xFF
    if kind not in (CELL, STRUCT, CHAR, *NUMERIC) or depth > DEEPEST:
        return
    shape = [int(size) for size in reader.numbers()]
    own = reader.text()
    name = name or own
    count = 1
    for size in shape:
        count *= size
    if min(shape, default=-1) < 0 or count > LARGEST_ARRAY:
        raise _Damaged
    if kind == CHAR:
        found.texts[name] = reader.text() if count else ""
    elif kind in NUMERIC:
        values = reader.numbers()
        if values.size != count:
            raise _Damaged
        if word & COMPLEX_FLAG:
            found.leave_out(name, "complex", count)
        else:
            found.add(name, values.reshape(shape, order="F"))
    elif count > MOST_ELEMENTS:
        raise _Damaged
    elif kind == CELL:
        for i in range(count):
            _take_next(found, reader, f"{name}{{{i}}}" if count > 1 else name, depth)
    else:
        fields = _fields(reader)
        for i in range(count):
            for inner in fields:
                _take_next(found, reader, f"{name}{f'({i})' if count > 1 else ''}.{inner}", depth)


def _take_next(found: NamedArrays, reader: _Reader, name: str, depth: int) -> None:
    kind, content = reader.element()
    if kind == MATRIX:
        _take(found, _Reader(content, reader.order), name, depth + 1)


def _fields(reader: _Reader) -> list[str]:
    """Return the names of a struct's fields: a length, then that many bytes for each."""
    lengths = reader.numbers()
    _, names = reader.element()
    length = int(lengths[0]) if lengths.size else 0
    if length < 1 or len(names) % length:
        raise _Damaged
    parts = (bytes(names[i : i + length]) for i in range(0, len(names), length))
    return [part.split(b"\0")[0].decode("latin-1") for part in parts]
