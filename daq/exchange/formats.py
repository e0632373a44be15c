"""File formats of other packages: entry points of the group ``mesotap.formats``, each named like a file's ending."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import RecordingError
from daq.exchange.recording import Columns
from rig.plugins import Offered, PluginError, module_of, offered, one_of, said_by

GROUP = "mesotap.formats"
"""Entry points of installed packages that hold a format; the name is the ending of its files, without the point."""

BUILT_IN = {
    "csv": "numbers in columns, as CSV or any other text",
    "txt": "the same",
    "mat": "MATLAB 5 and 7.3",
    "uff": "universal file: time responses in data sets 58, ASCII or binary",
    "unv": "the same",
    "uf": "the same",
    "ufb": "the same",
    "wav": "sound, as shares of full scale",
    "tdms": "LabVIEW and NI-DAQmx (with the extra tdms)",
    "h5": "session of mesotap",
    "hdf5": "the same",
}
"""Endings that the program reads itself, which no other format may have."""

ENDING = re.compile(r"[a-z0-9_]{1,16}")

FAILED = "the reader of this format failed"
"""Stands in the sentence of a reader that raised something else than `RecordingError`."""

REFUSED = "refused: "
"""Begins what a reader says of a file that it does not take, while it is checked."""


@dataclass(frozen=True, slots=True)
class FormatPlugin:
    """A format that a package reads.

    Attributes
    ----------
    ending
        Of its files, without the point, in small letters; the entry point has the same name.
    read
        Returns what a file holds, and raises `RecordingError` with one sentence where it is damaged. It is called in a
        process of its own that may write no file, and take no more memory and time than a file of that size needs.
    example
        Returns the content of an example file and what is in it, for `conformance`.
    summary
        Which program writes such files.
    """

    ending: str
    read: Callable[[Path], Columns]
    example: Callable[[], tuple[bytes, Columns]] | None = None
    summary: str = ""

    def columns(self, path: Path) -> Columns:
        """Return what a file holds, if that can be a recording.

        Raises
        ------
        RecordingError
            It is damaged, or the reader failed.
        """
        try:
            columns = self.read(path)
        except (RecordingError, MemoryError):
            raise
        except Exception as error:
            raise RecordingError(f"{path}: {FAILED}: {said_by(error)}") from error
        fault = fault_of(columns)
        if fault:
            raise RecordingError(f"{path}: {FAILED}: it returned {fault}")
        return columns


def fault_of(columns: object) -> str:
    """Return what is wrong with what a reader returned; empty if nothing is."""
    if type(columns) is not Columns:
        return f"a {type(columns).__name__}, no Columns of daq.exchange.recording"
    if not len(columns.names) == len(columns.units) == len(columns.data):
        return f"{len(columns.names)} names, {len(columns.units)} units and {len(columns.data)} channels"
    named = dict(zip(columns.names, columns.data, strict=True))
    if columns.time is not None:
        named[columns.time_name] = columns.time
    sizes = set()
    for name, values in named.items():
        if not isinstance(values, np.ndarray) or values.ndim != 1 or values.dtype.kind != "f":
            return f"a channel {name!r} that is no array (n,) of floating-point numbers"
        sizes.add(values.size)
    return "channels and times of different lengths" if len(sizes) > 1 else ""


def plugin_in(loaded: Any, where: str) -> FormatPlugin:
    """Return the format that a module, or an entry point's value, holds.

    Raises
    ------
    PluginError
        It holds none, or one that is not as it has to be.
    """
    held = loaded if isinstance(loaded, FormatPlugin) else getattr(loaded, "FORMAT", None)
    if not isinstance(held, FormatPlugin):
        raise PluginError(f"{where}: holds no FORMAT, a FormatPlugin of daq.exchange.formats")
    if not ENDING.fullmatch(held.ending):
        raise PluginError(
            f"{where}: its ending {held.ending!r} is not 1 to 16 small letters and digits without a point"
        )
    return held


def offered_formats() -> tuple[Offered, ...]:
    """Return the formats that installed packages offer, none of them imported."""
    return offered(GROUP)


def load(entry: Offered) -> FormatPlugin:
    """Import a format.

    Raises
    ------
    PluginError
        It cannot be used; or its ending is one that the program reads itself.
    """
    if entry.name in BUILT_IN:
        raise PluginError(f"{entry.where()}: mesotap itself reads files that end in .{entry.name}; it needs another")
    plugin = plugin_in(entry.loaded(), entry.where())
    if plugin.ending != entry.name:
        raise PluginError(f"{entry.where()}: reads files that end in .{plugin.ending}; both need the same name")
    return plugin


def installed(ending: str) -> FormatPlugin | None:
    """Return the format of that ending of an installed package, None where no package offers one.

    Raises
    ------
    PluginError
        Several packages offer it, or it cannot be used.
    """
    found = one_of((o for o in offered_formats() if o.name == ending), f"the format .{ending}")
    return None if found is None else load(found)


def format_named(name: str) -> FormatPlugin | None:
    """Return the format in a Python file, or the installed one of an ending; see `installed`."""
    return plugin_in(module_of(Path(name), "mesotap_format"), name) if name.endswith(".py") else installed(name)


def format_of(path: Path) -> FormatPlugin | None:
    """Return the format of another package that a file's ending names, None where none does.

    Raises
    ------
    RecordingError
        There is one, and it cannot be used.
    """
    ending = path.suffix.lower().removeprefix(".")
    if not ENDING.fullmatch(ending) or ending in BUILT_IN:
        return None
    try:
        return installed(ending)
    except PluginError as error:
        raise RecordingError(f"{path}: {error}") from error


def columns_by(path: Path, name: str) -> Columns:
    """Return what a file holds by a format that is checked; ``name`` as for `format_named`.

    Raises
    ------
    RecordingError
        As `FormatPlugin.columns`; where it is the reader that refused the file, the sentence begins with `REFUSED`.
    """
    plugin = format_named(name)
    if plugin is None:
        raise RecordingError(f"{path}: no installed package reads .{name}")
    try:
        return plugin.columns(path)
    except RecordingError as error:
        raise RecordingError(str(error) if FAILED in str(error) else f"{REFUSED}{error}") from error
