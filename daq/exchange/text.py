"""Columns of numbers in a text file: comma, semicolon, tab or blanks between them, with or without a header.

Fields may be quoted, as in RFC 4180: what stands in quotes may hold the delimiter, such as a decimal comma, and a title
may run over several lines.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.exchange.fields import (
    LONGEST_LINE,
    THOUSANDS,
    Line,
    decode,
    end_of,
    fault_of,
    head_of,
    is_comment,
    is_empty,
    is_number,
    lines_of,
    quoted_fields,
    records_of,
    split_fields,
)
from daq.exchange.recording import FEWEST_SAMPLES, Columns, is_even
from daq.exchange.titles import DELIMITERS, titles
from daq.exchange.units import is_time_name, is_time_unit, time_scale

_BLOCK = 4 * LONGEST_LINE  # characters of the text that are turned into numbers at once
_SAMPLE = 200  # lines of which half have to be numbers for a text to be a table
_MAYBE_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_QUOTED = re.compile(r'"([^"\n]*)"')
_SPLIT_DECIMAL = re.compile(r", *0\d")


def read_text(path: Path, content: bytes) -> Columns:
    """Return the columns of a text file.

    Times are taken from a column called so, or from a nameless first column that increases evenly.

    Raises
    ------
    RecordingError
        The file is not text, holds no table, or a line of the table is damaged: the line is named.
    """
    text = decode(path, content).replace("\r\n", "\n").replace("\r", "\n")
    head, comments = head_of(path, text)
    delimiter, begin = _layout(path, head)
    header: list[tuple[Line, list[str]]] = []
    width = 0
    for line, fields in records_of(path, iter(head), delimiter):
        if line is begin:
            width = len(fields)
            break
        header.append((line, fields))
    names, units = titles(path, header, comments, width, delimiter)
    end = end_of(text)
    _refuse_split_decimals(path, text, begin.offset, end, delimiter)
    _refuse_prose(path, text, begin, delimiter, width)
    table = _Table(path, delimiter, width)
    _take(table, text, begin, end)
    gap = table.finish()
    return _with_time(path, names, units, table, gap)


def _layout(path: Path, head: list[Line]) -> tuple[str, Line]:
    """Return the delimiter, and the first line on which nothing but numbers stands."""
    best: tuple[int, Line, str] | None = None
    unclosed: RecordingError | None = None
    for delimiter in DELIMITERS:
        try:
            for line, fields in records_of(path, iter(head), delimiter):
                if fields and all(is_number(text, delimiter != " ") for text in fields):
                    # The delimiter that yields more columns is the right one; a decimal comma never wins over ";" or
                    # tab.
                    if best is None or len(fields) > best[0]:
                        best = (len(fields), line, delimiter)
                    break
        except RecordingError as error:
            unclosed = unclosed or error
    if best is None and unclosed is not None:
        raise unclosed
    if best is None:
        for line, fields in records_of(path, iter(head), ","):
            for column, text in enumerate(fields):
                if "," in text and THOUSANDS.fullmatch(text) is not None:
                    raise RecordingError(f"{path}: line {line.number}, column {column + 1}: {fault_of(text)}")
        raise RecordingError(f"{path}: is not a recording: it holds no table of numbers")
    return best[2], best[1]


def _refuse_split_decimals(path: Path, text: str, begin: int, end: int, delimiter: str) -> None:
    """Refuse decimal commas that are taken for delimiters: digits after them begin with zeros, whole numbers do not."""
    if delimiter != "," or text.find(".", begin, end) >= 0 or text.find('"', begin, end) >= 0:
        return
    match = _SPLIT_DECIMAL.search(text, begin, end)
    if match is not None:
        number = text.count("\n", 0, match.start()) + 1
        raise RecordingError(
            f"{path}: line {number} holds a number that begins with a zero, as the digits after a decimal comma do: "
            "write decimal points, or part the columns by semicolons"
        )


def _refuse_prose(path: Path, text: str, begin: Line, delimiter: str, width: int) -> None:
    """Refuse a text in which numbers stand here and there."""
    sound = seen = 0
    lines = (line for line in lines_of(path, text, begin.offset, begin.number) if not is_empty(line.text))
    for _, fields in records_of(path, lines, delimiter):
        seen += 1
        sound += len(fields) == width and all(is_number(cell, delimiter != " ") for cell in fields)
        if seen == _SAMPLE:
            break
    if sound < seen / 2:
        raise RecordingError(f"{path}: is not a recording: it holds no table of numbers")


def _take(table: _Table, text: str, begin: Line, end: int) -> None:
    """Turn the text from the first line of numbers on into numbers, block by block."""
    offset, number = begin.offset, begin.number
    while offset < end:
        cut = end if end - offset <= _BLOCK else text.rfind("\n", offset, offset + _BLOCK)
        if cut < 0:
            raise RecordingError(
                f"{table.path}: is not a recording: it has a line of more than {LONGEST_LINE} characters"
            )
        block = text[offset:cut]
        lines = block.count("\n") + 1
        if not table.take_sound(block, lines, number):
            table.take_lines(block, number, cut == end)
        offset, number = cut + 1, number + lines


@dataclass(slots=True)
class _Table:
    """Numbers of a text as they are read.

    Attributes
    ----------
    blocks
        (n, width) numbers.
    comma, point
        Whether numbers had a decimal comma, or a point.
    sure, doubtful
        Whether a quoted comma was certainly a decimal one, and the first line where it may part thousands.
    pending, empty
        After the last numbers: lines that are blank (True) or comments, and the first line of delimiters alone.
    blanks, blank_gap, gap
        Blank lines that numbers followed, the first of them, and the first comment that numbers followed.
    """

    path: Path
    delimiter: str
    width: int
    blocks: list[NDArray[np.float64]] = field(default_factory=list)
    comma: bool = False
    point: bool = False
    sure: bool = False
    doubtful: int = 0
    blanks: int = 0
    pending: list[tuple[int, bool]] = field(default_factory=list)
    empty: int = 0
    gap: int = 0
    blank_gap: int = 0
    rows: int = 0

    def take_sound(self, block: str, lines: int, number: int) -> bool:
        """Take a block in which every line is one of numbers; return False if it is not, or has to be looked at."""
        point = "." in block
        comma = self.delimiter != "," and "," in block
        if self.delimiter == "," and self.sure and '"' in block:
            block, comma = _QUOTED.sub(lambda match: match[1].replace(",", "."), block), True
        elif comma:
            block = block.replace(",", ".")
        if (self.comma or comma) and (self.point or point):
            return False
        full = block.split("\n")
        blank = [number + i for i, line in enumerate(full) if not line] if "\n\n" in f"\n{block}\n" else []
        if len(blank) == lines:
            return False
        try:
            numbers = np.loadtxt(
                [line for line in full if line] if blank else full,
                delimiter=None if self.delimiter == " " else self.delimiter,
                comments=None,
                quotechar='"',
                ndmin=2,
            )
        except ValueError:
            return False
        if numbers.shape != (lines - len(blank), self.width) or not len(numbers):
            return False
        self.comma, self.point = self.comma or comma, self.point or point
        last = number + max(i for i in range(lines - len(blank) - 1, lines) if full[i])
        self.pending += [(line, True) for line in blank if line < last]
        self._close_gap(last)
        self.pending += [(line, True) for line in blank if line > last]
        self._add(numbers)
        return True

    def take_lines(self, block: str, number: int, is_last: bool) -> None:
        """Take a block line by line, and name the first that is wrong."""
        rows: list[list[float]] = []
        lines = lines_of(self.path, block, 0, number)
        for line in lines:
            if is_empty(line.text):
                if line.text.strip(" \t" if self.delimiter == " " else " "):
                    self.empty = self.empty or line.number
                else:
                    self.pending.append((line.number, True))
                continue
            if is_comment(line.text):
                self.pending.append((line.number, False))
                continue
            fields = (
                quoted_fields(self.path, line, lines, self.delimiter)
                if '"' in line.text
                else split_fields(line.text, self.delimiter)
            )
            self._close_gap(line.number)
            if len(fields) != self.width:
                last = is_last and next(lines, None) is None
                hint = "; the file seems truncated" if last and len(fields) < self.width else ""
                raise self._error(line.number, f" has {len(fields)} fields, expected {self.width}{hint}")
            rows.append([self._number(text, line.number, column) for column, text in enumerate(fields)])
        if rows:
            self._add(np.array(rows, dtype=np.float64))

    def _number(self, text: str, number: int, column: int) -> float:
        if not is_number(text, self.delimiter != " "):
            raise self._error(number, f", column {column + 1}: {fault_of(text)}")
        if "," in text:
            self.comma = True
            if self.delimiter == ",":
                doubtful = _MAYBE_THOUSANDS.fullmatch(text) is not None
                self.sure = self.sure or not doubtful
                self.doubtful = self.doubtful or (number if doubtful else 0)
            text = text.replace(",", ".")
        elif "." in text:
            self.point = True
        if self.comma and self.point:
            raise self._error(number, f", column {column + 1}: some numbers have a decimal comma, others a point")
        try:
            return float(text)
        except ValueError:
            return float(re.sub("[dD]", "e", text))

    def _close_gap(self, number: int) -> None:
        """Note that numbers follow what held none."""
        if self.empty:
            raise self._error(
                self.empty, f" is empty, with numbers above and below (line {number}): take it out, or fill it in"
            )
        for line, blank in self.pending:
            if blank:
                self.blanks += 1
                self.blank_gap = self.blank_gap or line
            else:
                self.gap = self.gap or line
        self.pending.clear()

    def _add(self, numbers: NDArray[np.float64]) -> None:
        self.blocks.append(numbers)
        self.rows += len(numbers)

    def finish(self) -> int:
        """Return the first line without numbers in the midst of numbers, 0 if there is none.

        A text with a blank line after each line of numbers has none.

        Raises
        ------
        RecordingError
            There are too few numbers, or what they are is in doubt.
        """
        if self.doubtful and not self.sure:
            raise self._error(
                self.doubtful, " has a comma in a number that may part thousands or be a decimal comma: write a point"
            )
        if self.rows < FEWEST_SAMPLES:
            raise RecordingError(
                f"{self.path}: holds only {self.rows} line{'s' * (self.rows != 1)} of numbers, expected at least "
                f"{FEWEST_SAMPLES}"
            )
        spaced = self.blanks >= self.rows - 1
        return self.gap or (0 if spaced else self.blank_gap)

    def column(self, i: int) -> NDArray[np.float64]:
        """Return a column (n,)."""
        return np.concatenate([block[:, i] for block in self.blocks])

    def _error(self, number: int, what: str) -> RecordingError:
        return RecordingError(f"{self.path}: line {number}{what}")


def _with_time(path: Path, names: list[str], units: list[str], table: _Table, gap: int) -> Columns:
    data = [table.column(i) for i in range(table.width)]
    table.blocks.clear()
    times = [i for i, name in enumerate(names) if is_time_name(name)]
    times = times or [i for i, unit in enumerate(units) if is_time_unit(unit)][:1]
    where = times[0] if times else None
    rest = [i for i in range(len(data)) if i not in times]
    if where is None and not names[0] and len(data) > 1 and np.isfinite(data[0]).all() and is_even(data[0]):
        rest = rest[1:]
        where = None if any(names) and _counts(data[0]) else 0
    time = None
    if where is not None:
        time = _seconds(path, names, units, data, where)
        for other in times[1:]:
            if not np.allclose(_seconds(path, names, units, data, other), time, rtol=1e-9, atol=0.0):
                raise RecordingError(
                    f"{path}: columns {where + 1} ({names[where]}) and {other + 1} ({names[other]}) are both of times, "
                    "and they differ: leave the right one in"
                )
    return Columns(
        names=[names[i] or f"column{i + 1}" for i in rest],
        units=[units[i] for i in rest],
        data=[data[i] for i in rest],
        time=time,
        time_name=(names[where] if where is not None else "") or "1",
        gap=gap,
    )


def _counts(values: NDArray[np.float64]) -> bool:
    """Return whether a column numbers the lines, from 0 or 1."""
    return values[0] in (0.0, 1.0) and bool((np.diff(values) == 1.0).all())


def _seconds(
    path: Path, names: list[str], units: list[str], data: list[NDArray[np.float64]], i: int
) -> NDArray[np.float64]:
    scale = time_scale(path, names[i], units[i])
    if scale == 1.0:
        return data[i]
    with np.errstate(over="ignore", invalid="ignore"):
        return data[i] * scale
