"""Reading a profilometer's scan from a text file: a profile or a map of heights, with units that are declared.

Accepted are

- columns ``x, z`` or ``x, y, z`` under a header that names units, such as ``x_um,z_nm`` or ``x [mm]; z [um]``, points
  evenly spaced (a map: every x at every y);
- heights alone, a line or a matrix (rows along y), with ``# spacing_um: 0.5`` and ``# unit: nm`` above them, or both
  given by the caller.

Numbers are parted by commas, semicolons, tabs or spaces; with semicolons a comma may be the decimal sign. An empty
cell or NaN is a point that was not measured.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.limited import read_limited
from daq.regular import read_regular
from rig.errors import MesotapError

FloatArray = NDArray[np.float64]
UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9, "å": 1e-10}
FEWEST_POINTS = 32  # along each direction
EVEN = 0.02  # steps may differ by this share of their mean
LARGEST_FILE = 100_000_000  # bytes
LONGEST_LINE = 10_000_000  # characters: a row of a map, or a profile, of a million points
SMALLEST_M, LARGEST_M = 1e-15, 1e3  # between which heights and spacings are believed
MOST_MISSING = 0.05  # share of the points that may be filled in
_SPLIT_DECIMAL = re.compile(r", *0\d")


class ScanError(MesotapError, ValueError):
    """A scan cannot be used; one sentence."""


@dataclass(frozen=True, slots=True)
class Scan:
    """Heights on an even grid.

    Attributes
    ----------
    height
        (n,) of a profile or (rows, n) of a map, m.
    spacing
        Along a profile; along a row and from row to row of a map; m.
    source
        Where it was read.
    missing
        Points that were filled in between their neighbours.
    """

    height: FloatArray
    spacing: tuple[float, ...]
    source: str = ""
    missing: int = 0


def read_scan(path: Path, unit: str | None = None, spacing_um: float | None = None) -> Scan:
    """Read a scan.

    Parameters
    ----------
    path
        The file.
    unit
        Unit of the heights, where the file does not say.
    spacing_um
        Spacing of the points, um, where the file does not say.

    Raises
    ------
    ScanError
        What is wrong with what is in the file, and where.
    RecordingError
        It cannot be read.

    Examples
    --------
    >>> scan = read_scan(Path("scan.sdf"))  # doctest: +SKIP
    >>> analyse_scan(scan).parameters  # doctest: +SKIP
    """
    return read_limited(scan_in, path, unit, spacing_um, kinds=(Scan,), errors=(ScanError, RecordingError))


def scan_in(path: Path, unit: str | None, spacing_um: float | None) -> Scan:
    """Return the scan in a file that this process opens itself; see `read_scan`."""
    content = read_regular(path, LARGEST_FILE, "a scan; export a part of it")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ScanError(f"{path}: is not a text file; export the scan as CSV") from None
    return parse_scan(text, str(path), unit, spacing_um)


DECLARATIONS = ("unit", "spacing_um")


def parse_scan(text: str, source: str = "scan", unit: str | None = None, spacing_um: float | None = None) -> Scan:
    """Return the scan that a file's text holds; arguments as `read_scan`."""
    if unit is not None and unit.lower() not in UNITS:
        raise ScanError(f"unit {unit!r} is not known; there are {', '.join(u for u in UNITS if u.isascii())}")
    if spacing_um is not None and not 0 < spacing_um < np.inf:
        raise ScanError(f"a spacing of {spacing_um:g} um is none")
    declared, lines = _declared(text, source)
    if not lines:
        raise ScanError(f"{source}: holds no numbers")
    separator = next((c for c in ";,\t" if c in lines[-1][1]), None)
    number, first = lines[0]
    names = [] if _numbers(first, separator) is not None else _cells(first, separator)
    rows = lines[1:] if names else lines
    if separator == ",":
        _refuse_split_decimals(rows, source)
    table = _table(rows, separator, source)
    if table.shape[1] > 1 and np.isnan(table[:, -1]).all() and (not names or names[-1] == ""):
        table, names = table[:, :-1], names[:-1]  # every line ends with a separator
    if not names:
        return _heights(table, declared, source, unit, spacing_um)
    return _columns(table, names, source, number, unit)


def _declared(text: str, source: str) -> tuple[dict[str, str], list[tuple[int, str]]]:
    declared: dict[str, str] = {}
    lines = []
    for number, raw in enumerate(text.splitlines(), start=1):
        if len(raw) > LONGEST_LINE:
            raise ScanError(
                f"{source}: line {number} has more than {LONGEST_LINE} characters; export a part of the scan"
            )
        line = raw.strip()
        if line.startswith("#"):
            key, colon, value = line[1:].partition(":")
            name = key.strip().lower()
            if colon and name in DECLARATIONS and name in declared:
                raise ScanError(f"{source}: line {number} declares {name!r} again; leave one of the two")
            if colon:
                declared[name] = value.strip()
        elif line:
            if "\0" in line:
                raise ScanError(f"{source}: line {number} is not text; export the scan as CSV")
            lines.append((number, raw.rstrip("\r\n ") if "\t" in raw else line))
    return declared, lines


def _refuse_split_decimals(rows: list[tuple[int, str]], source: str) -> None:
    """Refuse decimal commas that are taken for separators: digits after them begin with zeros, whole numbers do not."""
    if any("." in line or '"' in line for _, line in rows):
        return
    number = next((number for number, line in rows if _SPLIT_DECIMAL.search(line)), None)
    if number is not None:
        raise ScanError(
            f"{source}: line {number} holds a number that begins with a zero, as the digits after a decimal comma do: "
            "write decimal points, or part the numbers by semicolons"
        )


def _cells(line: str, separator: str | None) -> list[str]:
    if '"' in line and separator is not None:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
        except csv.Error:  # a field longer than any number
            return [line]
    return [cell.strip().strip('"') for cell in line.split(separator)]


def _number(cell: str, separator: str | None) -> float:
    if cell == "" or cell.lower() in ("nan", "bad", "n/a"):
        return np.nan
    if "_" in cell:  # which Python takes for a separator of digits
        raise ValueError
    value = float(cell.replace(",", ".") if separator == ";" else cell)
    if np.isinf(value):
        raise ValueError
    return value


def _numbers(line: str, separator: str | None) -> list[float] | None:
    try:
        return [_number(cell, separator) for cell in _cells(line, separator)]
    except ValueError:
        return None


def _table(rows: list[tuple[int, str]], separator: str | None, source: str) -> FloatArray:
    table: list[list[float]] = []
    for number, line in rows:
        values = _numbers(line, separator)
        if values is None:
            raise ScanError(f"{source}: line {number} holds something that is not a number: {line[:60]!r}")
        if table and len(values) != len(table[0]):
            raise ScanError(f"{source}: line {number} has {len(values)} numbers, the lines above have {len(table[0])}")
        table.append(values)
    if not table:
        raise ScanError(f"{source}: holds a header but no numbers")
    return np.array(table, dtype=np.float64)


def _heights(
    table: FloatArray, declared: dict[str, str], source: str, unit: str | None, spacing_um: float | None
) -> Scan:
    unit = unit or declared.get("unit")
    if unit is None or unit.lower() not in UNITS:
        said = "does not say" if unit is None else f"says {unit!r} for"
        raise ScanError(f"{source}: {said} the unit of its heights; write '# unit: nm' above them or give --unit")
    spacing = spacing_um if spacing_um is not None else _declared_spacing(declared, source)
    if spacing is None:
        raise ScanError(
            f"{source}: does not say how far apart its points are; write '# spacing_um: 0.5' above them or "
            "give --spacing-um"
        )
    heights = table[:, 0] if table.shape[1] == 1 else table[0] if table.shape[0] == 1 else table
    return _scan(heights * UNITS[unit.lower()], (spacing * 1e-6,) * heights.ndim, source)


def _declared_spacing(declared: dict[str, str], source: str) -> float | None:
    text = declared.get("spacing_um")
    if text is None:
        return None
    try:
        spacing = float(text)
    except ValueError:
        spacing = -1.0
    if not 0 < spacing < np.inf:
        raise ScanError(f"{source}: spacing_um is {text!r}, which is not a spacing")
    return spacing


def _columns(table: FloatArray, names: list[str], source: str, line: int, unit: str | None) -> Scan:
    found: dict[str, tuple[int, float]] = {}
    for index, name in enumerate(names):
        match = re.fullmatch(r"([xyz])(?:[_\s]*[\[(]?\s*([a-zA-Zµμå]+)\s*[\])]?)?", name.strip(), re.IGNORECASE)
        if match is None:
            continue
        axis, said = match[1].lower(), match[2] or (unit if match[1].lower() == "z" else None)
        if said is None or said.lower() not in UNITS:
            raise ScanError(
                f"{source}: line {line}: column {name!r} does not name a unit that is known, such as {axis}_um"
            )
        if axis in found:
            raise ScanError(f"{source}: line {line} names {axis} twice")
        found[axis] = index, UNITS[said.lower()]
    if "z" not in found or "x" not in found:
        raise ScanError(f"{source}: line {line} is not a header with x and z (and y for a map), such as 'x_um,z_nm'")
    if len(names) != table.shape[1]:
        raise ScanError(f"{source}: line {line} names {len(names)} columns, the lines below have {table.shape[1]}")
    axes = {axis: table[:, index] * scale for axis, (index, scale) in found.items()}
    for axis in ("x", "y"):
        if axis in axes and not np.isfinite(axes[axis]).all():
            raise ScanError(f"{source}: a point has no {axis}")
    if "y" not in axes:
        order = np.argsort(axes["x"], kind="stable")
        return _scan(axes["z"][order], (_step(axes["x"][order], "x", source),), source)
    return _map(axes, source)


def _map(axes: dict[str, FloatArray], source: str) -> Scan:
    x, column = np.unique(axes["x"], return_inverse=True)
    y, row = np.unique(axes["y"], return_inverse=True)
    if len(x) * len(y) != len(axes["z"]):
        raise ScanError(
            f"{source}: {len(axes['z'])} points are no full grid of {len(x)} different x and {len(y)} different y"
        )
    heights = np.full((len(y), len(x)), np.nan)
    seen = np.zeros(heights.shape, bool)
    seen[row, column] = True
    heights[row, column] = axes["z"]
    if not seen.all():
        raise ScanError(f"{source}: some points of the grid are there twice and others not at all")
    return _scan(heights, (_step(x, "x", source), _step(y, "y", source)), source)


def _step(x: FloatArray, axis: str, source: str) -> float:
    steps = np.diff(x)
    step = float(steps.mean()) if len(steps) else 0.0
    if step <= 0 or np.abs(steps - step).max() > EVEN * step:
        raise ScanError(f"{source}: the points are not evenly spaced along {axis}; interpolate them before")
    return step


def _scan(heights: FloatArray, spacing: tuple[float, ...], source: str) -> Scan:
    if min(heights.shape) < FEWEST_POINTS:
        shape = " x ".join(map(str, heights.shape))
        raise ScanError(f"{source}: {shape} points are too few; {FEWEST_POINTS} along each direction are needed")
    missing = ~np.isfinite(heights)
    count = int(missing.sum())
    if count > MOST_MISSING * heights.size:
        raise ScanError(f"{source}: {count} of {heights.size} points were not measured, more than can be filled in")
    if count:
        rows = np.atleast_2d(heights).copy()
        for row in rows:
            known = np.isfinite(row)
            if not known.any():
                raise ScanError(f"{source}: a whole row was not measured")
            row[~known] = np.interp(np.flatnonzero(~known), np.flatnonzero(known), row[known])
        heights = rows.reshape(heights.shape)
    if np.ptp(heights) == 0:
        raise ScanError(f"{source}: all heights are the same")
    # the differences count, whatever the heights are above
    for what, least_m, most_m in (
        ("its heights differ by", float(np.ptp(heights)), float(np.abs(heights).max())),
        ("its points are apart by", min(spacing), max(spacing)),
    ):
        if not (least_m >= SMALLEST_M and most_m <= LARGEST_M):
            wrong_m = least_m if least_m < SMALLEST_M else most_m
            raise ScanError(
                f"{source}: {what} {wrong_m:g} m, expected {SMALLEST_M:g} to {LARGEST_M:g} m (less than an atomic "
                "nucleus, more than a road): check the units"
            )
    return Scan(heights, spacing, source, count)
