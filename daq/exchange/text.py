"""Columns of numbers in a text file: comma, semicolon, tab or blanks between them, with or without a header."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.exchange.recording import FEWEST_SAMPLES, Columns, is_even, is_time_name, time_scale

DELIMITERS = (";", "\t", ",", " ")
LONGEST_HEADER = 100
"""Lines without numbers at the top beyond which a text is not taken for a table."""

LONGEST_LINE = 1_000_000
"""Characters of a line beyond which a text is not taken for a table: a thousand columns take twenty thousand."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_UNIT = re.compile(r"(.*?)[\s_]*[\[(]([^\])]*)[\])]\s*")


def decode(path: Path, content: bytes) -> str:
    """Return the text in a file.

    Raises
    ------
    RecordingError
        It is no text.
    """
    try:
        text = content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    if any((ord(c) < 32 and c not in "\t\n\r\f\x1a") or 127 <= ord(c) < 160 for c in text[:100_000]):
        raise RecordingError(f"{path}: is no recording that this program knows (CSV, MAT or universal file)")
    return text


def read_text(path: Path, content: bytes) -> Columns:
    """Return the columns of a text file.

    Times are taken from a column called so, or from a nameless first column that increases evenly.

    Raises
    ------
    RecordingError
        The file is no text, holds no table, or a line of the table is damaged: the line is named.
    """
    lines = decode(path, content).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if max(map(len, lines)) > LONGEST_LINE:
        raise RecordingError(f"{path}: is no recording: it has a line of more than {LONGEST_LINE} characters")
    numbered = [
        (number, line.strip("\x1a\f ")) for number, line in enumerate(lines, start=1) if line.strip("\x1a\f \t;,")
    ]
    rows = [(number, line) for number, line in numbered if not line.startswith(("#", "%", "//"))]
    comments = [line.lstrip("#%/ ") for _, line in numbered if line.startswith(("#", "%", "//"))][:LONGEST_HEADER]
    delimiter, begin = _layout(path, [line for _, line in rows[: LONGEST_HEADER + 1]])
    decimal_comma = delimiter in (";", "\t") and not any("." in line for _, line in rows[begin : begin + 1000])
    table = _numbers(path, rows[begin:], delimiter, decimal_comma)
    width = table.shape[1]
    header = [_split(line, delimiter) for _, line in rows[:begin]] or [_split(line, delimiter) for line in comments]
    names, units = _titles([fields for fields in header if len(fields) == width], width)
    return _with_time(names, units, table)


def _split(line: str, delimiter: str) -> list[str]:
    fields = line.split() if delimiter == " " else line.split(delimiter)
    return [field.strip().strip("\"'").strip() for field in fields]


def _is_number(text: str, decimal_comma: bool) -> bool:
    return len(text) < 64 and _NUMBER.fullmatch(text.replace(",", ".") if decimal_comma else text) is not None


def _layout(path: Path, lines: list[str]) -> tuple[str, int]:
    """Return the delimiter, and the first line on which nothing but numbers stands."""
    best: tuple[int, int, str] | None = None
    for delimiter in DELIMITERS:
        for begin, line in enumerate(lines):
            fields = _split(line, delimiter)
            if fields and all(_is_number(text, delimiter in (";", "\t")) for text in fields):
                # The delimiter that yields more columns is the right one; a decimal comma never wins over ";" or tab.
                if best is None or len(fields) > best[0]:
                    best = (len(fields), begin, delimiter)
                break
    if best is None:
        raise RecordingError(f"{path}: is no recording: it holds no table of numbers")
    return best[2], best[1]


def _numbers(path: Path, rows: list[tuple[int, str]], delimiter: str, decimal_comma: bool) -> NDArray[np.float64]:
    fields = [_split(line, delimiter) for _, line in rows]
    width = len(fields[0])
    if width > 1 and fields[0][-1] == "":
        raise RecordingError(f"{path}: line {rows[0][0]} ends in an empty field")
    sound = sum(len(row) == width and all(_is_number(text, decimal_comma) for text in row) for row in fields[:200])
    if sound < len(fields[:200]) / 2:
        raise RecordingError(f"{path}: is no recording: it holds no table of numbers")
    for (number, _), row in zip(rows, fields, strict=True):
        if len(row) != width:
            last = number == rows[-1][0]
            hint = "; the file seems truncated" if last and len(row) < width else ""
            raise RecordingError(f"{path}: line {number} has {len(row)} fields, expected {width}{hint}")
        for column, text in enumerate(row):
            if not _is_number(text, decimal_comma):
                what = f"{text!r:.40} is no number" if text else "is empty"
                raise RecordingError(f"{path}: line {number}, column {column + 1}: {what}")
    if len(fields) < FEWEST_SAMPLES:
        raise RecordingError(f"{path}: holds only {len(fields)} lines of numbers, expected at least {FEWEST_SAMPLES}")
    if decimal_comma:
        fields = [[text.replace(",", ".") for text in row] for row in fields]
    try:
        return np.array([[float(text) for text in row] for row in fields], dtype=np.float64)
    except ValueError:
        return np.array([[float(re.sub("[dD]", "e", text)) for text in row] for row in fields], dtype=np.float64)


def _titles(header: list[list[str]], width: int) -> tuple[list[str], list[str]]:
    """Return names and units from the header lines that have as many fields as the table."""
    names, units = [""] * width, [""] * width
    if not header:
        return names, units
    title = header[-1]
    if len(header) > 1 and is_unit_row(header[-1]):
        title, units = header[-2], [unit.strip("[]() ") for unit in header[-1]]
    for i, text in enumerate(title):
        match = _UNIT.fullmatch(text)
        names[i] = (match[1] or text) if match else text
        units[i] = match[2].strip() if match and match[2].strip() else units[i]
    return names, units


def is_unit_row(fields: list[str]) -> bool:
    """Return whether a header line looks like units: all short, one of them known or with a slash or brackets."""
    bare = [text.strip("[]() ") for text in fields]
    return all(len(text) <= 8 for text in bare) and any(
        "/" in text or text in ("s", "ms", "g", "V", "mV", "N") or raw[:1] in "[("
        for raw, text in zip(fields, bare, strict=True)
        if raw
    )


def _with_time(names: list[str], units: list[str], table: NDArray[np.float64]) -> Columns:
    named = [i for i, name in enumerate(names) if is_time_name(name)]
    where = named[0] if named else None
    if (
        where is None
        and not names[0]
        and table.shape[1] > 1
        and np.isfinite(table[:, 0]).all()
        and is_even(table[:, 0])
    ):
        where = 0
    time = None
    if where is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            time = table[:, where] * time_scale(names[where], units[where])
    rest = [i for i in range(table.shape[1]) if i != where]
    return Columns(
        names=[names[i] or f"column{i + 1}" for i in rest],
        units=[units[i] for i in rest],
        data=[np.ascontiguousarray(table[:, i]) for i in rest],
        time=time,
        time_name=(names[where] if where is not None else "") or "1",
    )
