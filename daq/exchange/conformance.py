"""Conformance checks of a file format, for anyone who writes a reader of their own."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from daq.errors import RecordingError
from daq.exchange.formats import BUILT_IN, REFUSED, FormatPlugin, columns_by, fault_of, format_named
from daq.exchange.recording import Columns, make_recording
from daq.limited import LimitedReader
from rig.plugins import Check, PluginError

CUTS = 24
"""Lengths to which the example is cut."""

DAMAGED = 48
"""Copies of the example with some bytes changed."""

SEED = 20
SAME = 1e-9  # relative difference that is put down to the digits of a text
OTHER = b"this is a letter, and no recording of any kind\n"


def conformance(name: str) -> list[Check]:
    """Check a format: the installed one of this ending, or the one in this Python file.

    Its example is read back as it was written; no file that is cut, damaged, empty or another thing altogether makes
    its reader fail otherwise than by a `RecordingError`. Files are read as `mesotap analyze` reads them: by a process
    with limits.
    """
    name = name if Path(name).suffix == ".py" else name.removeprefix(".")  # as `mesotap formats` lists it
    try:
        plugin = format_named(name)
    except PluginError as error:
        return [Check("it is a format", False, str(error))]
    if plugin is None:
        own = f"mesotap itself reads .{name}" if name in BUILT_IN else f"no installed package reads .{name}"
        return [Check("it is a format", False, f"{own}; name the ending of a package's, or a Python file with one")]
    found = [Check("it is a format", True, f".{plugin.ending}"), _free(plugin)]
    if plugin.example is None:
        return [*found, Check("its reader", True, "was not tried: it has no example")]
    try:
        content, expected = plugin.example()
    except Exception as error:
        return [*found, Check("its example", False, f"{type(error).__name__}: {error}")]
    fault = fault_of(expected) if isinstance(content, bytes) else "no bytes for the file's content"
    if fault:
        return [*found, Check("its example", False, f"it returned {fault}")]
    with tempfile.TemporaryDirectory(prefix="mesotap-format-") as folder, LimitedReader() as reader:
        tried = _Tried(name, Path(folder) / f"example.{plugin.ending}", reader)
        return [*found, *tried.checks(content, expected)]


def _free(plugin: FormatPlugin) -> Check:
    taken = plugin.ending in BUILT_IN
    return Check("its ending is free", not taken, f"mesotap itself reads .{plugin.ending}" if taken else "")


class _Tried:
    """Reads files through one process with limits."""

    def __init__(self, name: str, path: Path, reader: LimitedReader) -> None:
        self._name = name
        self._path = path
        self._reader = reader

    def checks(self, content: bytes, expected: Columns) -> Iterator[Check]:
        """Yield what is checked of the reader with an example."""
        try:
            read = self._read(content)
        except RecordingError as error:
            yield Check("its example can be read", False, str(error))
            return
        yield Check("its example can be read", True)
        difference = _difference(read, expected)
        yield Check("its example is read as it was written", not difference, difference)
        try:
            recording = make_recording(self._path, read, None if _knows_its_rate(read) else 1000.0, None, None)
            said = f"{len(recording.names)} channels, {recording.data.shape[1]} samples at {recording.rate_hz:g} Hz"
            yield Check("its example is a recording", True, said)
        except RecordingError as error:
            yield Check("its example is a recording", False, str(error))
        lengths = sorted({len(content) * i // CUTS for i in range(CUTS)})
        yield self._survives("a file that is cut", [content[:n] for n in lengths])
        yield self._survives("a damaged file", list(_damaged(content)))
        yield self._refuses("an empty file", b"")
        yield self._refuses("another file of that name", OTHER)

    def _read(self, content: bytes) -> Columns:
        self._path.write_bytes(content)
        return self._reader.read(columns_by, self._path, self._name, kinds=(Columns,))

    def _survives(self, what: str, contents: list[bytes]) -> Check:
        name, refused = f"{what} is read or refused in a sentence", 0
        for number, content in enumerate(contents):
            try:
                self._read(content)
            except RecordingError as error:
                refused += 1
                if not str(error).startswith(REFUSED):
                    return Check(name, False, f"number {number} of {len(contents)}, {len(content)} bytes: {error}")
        return Check(name, True, f"{refused} of {len(contents)} refused")

    def _refuses(self, what: str, content: bytes) -> Check:
        name = f"{what} is refused in a sentence"
        try:
            self._read(content)
        except RecordingError as error:
            said = str(error)
            return Check(name, said.startswith(REFUSED), said.removeprefix(REFUSED))
        return Check(name, False, "it was read")


def _knows_its_rate(columns: Columns) -> bool:
    return columns.time is not None or columns.rate_hz is not None


def _damaged(content: bytes) -> Iterator[bytes]:
    """Yield copies with bytes changed, taken out or put in twice."""
    random = np.random.default_rng(SEED)
    for _ in range(DAMAGED):
        copy = bytearray(content)
        for place in random.integers(0, max(len(copy), 1), size=random.integers(1, 9)):
            copy[place : place + 1] = bytes(random.integers(0, 256, size=random.integers(0, 3), dtype=np.uint8))
        yield bytes(copy)


def _difference(read: Columns, expected: Columns) -> str:
    if (read.names, read.units) != (expected.names, expected.units):
        return f"channels {read.names} in {read.units}, expected {expected.names} in {expected.units}"
    pairs = list(zip(read.names, read.data, expected.data, strict=True))
    if (read.time is None) != (expected.time is None):
        return "times are read where there are none, or the other way round"
    if read.time is not None and expected.time is not None:
        pairs.append((read.time_name, read.time, expected.time))
    for name, one, other in pairs:
        if one.shape != other.shape:
            return f"{name} has {one.size} samples, expected {other.size}"
        scale = float(np.max(np.abs(other), initial=0.0))
        if not np.allclose(one, other, rtol=SAME, atol=SAME * scale, equal_nan=True):
            return f"{name} holds other numbers than were written"
    rates = read.rate_hz, expected.rate_hz
    if (rates[0] is None) != (rates[1] is None) or (rates[0] and rates[1] and abs(rates[0] / rates[1] - 1) > SAME):
        return f"its sampling rate is {rates[0]}, expected {rates[1]}"
    return ""
