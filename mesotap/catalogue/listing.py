"""Sessions of the catalogue for other programs: JSON a session, a table of a row a load as CSV or Parquet."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from mesotap.answers.results_files import table_csv
from mesotap.catalogue.entry import GONE, MOVED, Entry, Found, LoadEntry
from rig.errors import MesotapError

SESSION_COLUMNS = (
    *("path", "name", "state", "reason", "created", "operator", "specimen", "title", "software", "sha256", "simulated"),
    *("taps", "accepted", "verdict", "drifted", "k1_n_per_m", "k2_n_per_m", "slope_mv_per_mn", "zero_mv", "noise_m_s2"),
)
_OF_LOAD = tuple(f.name for f in fields(LoadEntry))
_PLAIN = ("load_set", "target_load_mn", "impacts_used")
_ESTIMATES = tuple(name for name in _OF_LOAD if name not in _PLAIN)
COLUMNS = (
    *SESSION_COLUMNS,
    "mechanisms",
    *_PLAIN,
    *(column for name in _ESTIMATES for column in (name, f"{name}_low", f"{name}_high")),
)


class NoParquet(MesotapError, RuntimeError):
    """What writes Parquet is not installed."""


def copies(entries: Sequence[Entry]) -> dict[str, str]:
    """Return the paths of sessions that have the content of another one, with that one's path.

    Of several the one with results is the session, and the others its copies.
    """
    first: dict[str, str] = {}
    found = {}
    for entry in sorted(entries, key=lambda e: (not e.loads, not e.verdict, e.path)):
        if not entry.sha256 or entry.state in (MOVED, GONE):
            continue
        if entry.sha256 in first:
            found[entry.path] = first[entry.sha256]
        else:
            first[entry.sha256] = entry.path
    return found


def sessions_json(entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """Return sessions as JSON types, each with the path of the one that it is a copy of, or null."""
    of = copies(entries)
    return [{**entry.as_json(), "copy_of": of.get(entry.path)} for entry in entries]


def rows(entries: Sequence[Entry]) -> list[list[object]]:
    """Return a row for each load of each session, by `COLUMNS`; of a session without loads one that has none."""
    return [[*_session(entry), *_load(load)] for entry in entries for load in (entry.loads or (None,))]


def loads_csv(entries: Sequence[Entry]) -> str:
    """Return the table as CSV."""
    return table_csv(COLUMNS, [[int(c) if isinstance(c, bool) else c for c in row] for row in rows(entries)])


def loads_parquet(entries: Sequence[Entry]) -> bytes:
    """Return the table as a Parquet file.

    Raises
    ------
    NoParquet
        pyarrow is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise NoParquet("Parquet needs pyarrow: pip install 'mesotap[parquet]'; --csv needs nothing") from error
    texts, whole = {"mechanisms", *_TEXTS}, {"taps", "accepted", "load_set", "impacts_used"}
    kinds = {
        **dict.fromkeys(COLUMNS, pyarrow.float64()),
        **dict.fromkeys(texts, pyarrow.string()),
        **dict.fromkeys(whole, pyarrow.int64()),
        **dict.fromkeys(("simulated", "drifted"), pyarrow.bool_()),
    }
    columns = zip(*rows(entries), strict=True) if entries else [()] * len(COLUMNS)
    made = {
        name: pyarrow.array([_storable(v) for v in column], kinds[name])
        for name, column in zip(COLUMNS, columns, strict=True)
    }
    stream = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(made), stream)
    return stream.getvalue()


_TEXTS = tuple(f.name for f in fields(Entry) if f.type == "str" and f.name in SESSION_COLUMNS)


def _storable(value: object) -> object:
    return value.encode("utf-8", "surrogateescape").decode("utf-8", "replace") if isinstance(value, str) else value


def _session(entry: Entry) -> list[object]:
    named = "; ".join(m.id for m in entry.mechanisms)
    return [*(getattr(entry, name) for name in SESSION_COLUMNS), named]


def _load(load: LoadEntry | None) -> list[object]:
    if load is None:
        return [None] * (len(_PLAIN) + 3 * len(_ESTIMATES))
    cells: list[object] = [getattr(load, name) for name in _PLAIN]
    for name in _ESTIMATES:
        found: Found | None = getattr(load, name)
        cells += [None] * 3 if found is None else [found.value, found.low, found.high]
    return cells
