"""Tables of numbers in a file: columns that belong together, several tables to a file where it has structs of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.exchange.formats import format_of
from daq.exchange.importing import columns_of, content_of, is_hdf5, is_mat5
from daq.exchange.recording import Columns
from daq.limited import read_limited


class NoTable(RecordingError):
    """A file holds no table with the columns wanted."""


@dataclass(frozen=True, slots=True)
class Table:
    """Columns (n,) of one length in the order of the file, by name."""

    name: str
    columns: dict[str, NDArray[np.float64]]


def import_tables(path: Path, wanted: Sequence[str | int]) -> tuple[Table, ...]:
    """Return the tables in a CSV or MAT file that hold all columns wanted, cut down to these, under the names wanted.

    A MAT file has a table wherever arrays of one length stand beside each other; a text file is one table.

    Raises
    ------
    NoTable
        No table holds all columns.
    RecordingError
        The file cannot be read, or one of the columns holds a NaN.
    """
    return read_limited(tables_in, path, list(wanted), kinds=(Table,), errors=(RecordingError, NoTable))


def tables_in(path: Path, wanted: Sequence[str | int]) -> tuple[Table, ...]:
    """Return the tables in a file that this process opens itself; see `import_tables`."""
    other = format_of(path)
    content = b"" if other is not None else content_of(path)
    if other is not None:
        tables = [_of_columns(other.columns(path))]
    elif is_hdf5(content):
        from daq.exchange.matlab73 import walk_mat73

        tables = _grouped(walk_mat73(path).arrays)
    elif is_mat5(path, content):
        from daq.exchange.matlab5 import walk_mat5

        tables = _grouped(walk_mat5(path, content).arrays)
    else:
        tables = [_of_columns(columns_of(path, content))]
    found = []
    for table in tables:
        picked = [_pick(table, w) for w in wanted]
        if all(c is not None for c in picked):
            columns = {str(w): np.asarray(c, np.float64) for w, c in zip(wanted, picked, strict=True)}
            if not all(np.all(np.isfinite(c)) for c in columns.values()):
                raise RecordingError(
                    f"{path}: the table {table.name or 'of the file'} holds values that are no numbers"
                )
            found.append(Table(table.name, columns))
    if not found:
        raise NoTable(f"{path}: holds no table with the columns {', '.join(map(str, wanted))}")
    return tuple(found)


def _of_columns(read: Columns) -> Table:
    first = [] if read.time is None else [(read.time_name, read.time)]
    return Table("", dict([*first, *zip(read.names, read.data, strict=True)]))


def _grouped(arrays: Sequence[tuple[str, NDArray[np.float64]]]) -> list[Table]:
    groups: dict[tuple[str, int], dict[str, NDArray[np.float64]]] = {}
    for name, values in arrays:
        flat = np.squeeze(values)
        parent, _, leaf = name.rpartition(".")
        if flat.ndim == 1 and flat.size > 1:
            groups.setdefault((parent, flat.size), {})[leaf] = flat
        elif flat.ndim == 2 and min(flat.shape) <= 64:
            rows = flat if flat.shape[0] <= flat.shape[1] else flat.T
            groups[(name, rows.shape[1])] = {f"column{i + 1}": row for i, row in enumerate(rows)}
    return [Table(parent, columns) for (parent, _), columns in groups.items()]


def _pick(table: Table, wanted: str | int) -> NDArray[np.float64] | None:
    if isinstance(wanted, str):
        return table.columns.get(wanted)
    names = list(table.columns)
    return table.columns[names[wanted]] if wanted < len(names) else None
