"""Lines and fields of a text table: comments, quotes as in RFC 4180, and what is a number."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from daq.errors import RecordingError

LONGEST_HEADER = 100
"""Lines without numbers at the top beyond which a text is not taken for a table."""

LONGEST_LINE = 1_000_000
"""Characters of a line beyond which a text is not taken for a table: a thousand columns take twenty thousand."""

LONGEST_FIELD = 10
"""Lines that a quoted field may run over."""

_EDGES = "\x1a\f "
_COMMENT = ("#", "%", "//")
_SPREADSHEET_ERROR = re.compile(r"#(N/?A|NV|DIV/0!|REF!|VALUE!|NUM!|NAME\?|NULL!|[A-Z]+!)")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_LONGEST_NUMBER = 64
THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?")
"""A number with commas between thousands."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line: its number, from 1, where it begins in the text, and what it holds."""

    number: int
    offset: int
    text: str


def decode(path: Path, content: bytes) -> str:
    """Return the text in a file.

    Raises
    ------
    RecordingError
        It is not text.
    """
    try:
        text = content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    if any((ord(c) < 32 and c not in "\t\n\r\f\x1a") or 127 <= ord(c) < 160 for c in text[:100_000]):
        raise RecordingError(f"{path}: is not a recording that this program knows (CSV, MAT or universal file)")
    return text


def lines_of(path: Path, text: str, offset: int, number: int) -> Iterator[Line]:
    """Return the lines of a text from an offset on, the first of which has this number."""
    while offset <= len(text):
        end = text.find("\n", offset)
        end = len(text) if end < 0 else end
        if end - offset > LONGEST_LINE:
            raise RecordingError(f"{path}: is not a recording: it has a line of more than {LONGEST_LINE} characters")
        yield Line(number, offset, text[offset:end].strip(_EDGES))
        offset, number = end + 1, number + 1


def is_comment(text: str) -> bool:
    """Return whether a line is a comment; what spreadsheets write for a failure is none."""
    return text.startswith(_COMMENT) and not _SPREADSHEET_ERROR.match(text)


def is_empty(text: str) -> bool:
    """Return whether nothing stands between the delimiters of a line."""
    return not text.strip('\t;," ' + _EDGES)


def head_of(path: Path, text: str) -> tuple[list[Line], list[Line]]:
    """Return the first lines that hold something, and the comments among them."""
    rows: list[Line] = []
    comments: list[Line] = []
    for line in lines_of(path, text, 0, 1):
        if is_comment(line.text):
            comments += [line] if len(comments) < LONGEST_HEADER else []
        elif not is_empty(line.text):
            rows.append(line)
            if len(rows) > LONGEST_HEADER:
                break
    return rows, comments


def end_of(text: str) -> int:
    """Return where the last line ends that holds something."""
    end = text.find("\n", len(text.rstrip('\n\t;,"' + _EDGES)))
    return len(text) if end < 0 else end


def split_fields(text: str, delimiter: str) -> list[str]:
    """Return the fields of a line without double quotes."""
    fields = text.split() if delimiter == " " else text.split(delimiter)
    return [field.strip().strip("'").strip() for field in fields]


def records_of(path: Path, lines: Iterator[Line], delimiter: str) -> Iterator[tuple[Line, list[str]]]:
    """Return the fields of each line, told by where it begins: what stands in quotes may run over several lines."""
    for line in lines:
        if '"' not in line.text:
            yield line, split_fields(line.text, delimiter)
        else:
            yield line, quoted_fields(path, line, lines, delimiter)


def quoted_fields(path: Path, line: Line, more: Iterator[Line], delimiter: str) -> list[str]:
    """Return the fields of a line with double quotes, and take what they run over from the lines that follow."""
    ended = False

    def texts() -> Iterator[str]:
        nonlocal ended
        blanks = delimiter == " "
        yield line.text.replace("\t", " ") if blanks else line.text
        for _ in range(LONGEST_FIELD):
            following = next(more, None)
            if following is None:
                break
            yield "\n" + following.text
        ended = True

    try:
        fields = next(csv.reader(texts(), delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:
        raise RecordingError(f"{path}: line {line.number} has a quoted field that cannot be read: {error}") from error
    if ended:
        raise RecordingError(f"{path}: line {line.number} opens a quote that is not closed")
    return [" ".join(field.split()).strip("\"'").strip() for field in fields]


def is_number(text: str, decimal_comma: bool) -> bool:
    """Return whether a field is a number."""
    return (
        len(text) < _LONGEST_NUMBER and _NUMBER.fullmatch(text.replace(",", ".") if decimal_comma else text) is not None
    )


def fault_of(text: str) -> str:
    """Return what is wrong with a field that is not a number."""
    if not text:
        return "is empty"
    hint = ": write numbers without commas between thousands" if THOUSANDS.fullmatch(text) else ""
    return f"{text!r:.40} is not a number{hint}"
