"""What stands above a text table: names and units of its columns."""

from __future__ import annotations

import csv
import re
from pathlib import Path

from daq.errors import RecordingError
from daq.exchange.fields import Line, fault_of, is_number, split_fields
from daq.exchange.units import is_no_acceleration, is_time_name, is_time_unit, to_si

DELIMITERS = (";", "\t", ",", " ")
LONGEST_UNIT_TITLE = 8
"""Characters of a unit in a line of units."""

_UNIT = re.compile(r"(.*?)[\s_]*[\[(]([^\])]*)[\])]\s*")
_UNIT_AFTER = re.compile(r"(.*?)\s*(?:,|\s/)\s*(\S+)")


def titles(
    path: Path, header: list[tuple[Line, list[str]]], comments: list[Line], width: int, delimiter: str
) -> tuple[list[str], list[str]]:
    """Return names and units from the header lines that have as many fields as the table.

    Raises
    ------
    RecordingError
        What stands right above the numbers names another number of columns, or is a line of numbers but for a field.
    """
    names, units = [""] * width, [""] * width
    full = [fields for _, fields in header if len(fields) == width]
    if header:
        _refuse_mixed(path, header, width, delimiter)
        line, fields = header[-1]
        if len(fields) != width:
            other = _parted_otherwise(line.text, width)
            if other is None and _names_columns(fields, delimiter):
                raise _miscounted(path, line, fields, width)
            full += [] if other is None else [other]
    else:
        parted = [(line, _split_quoted(line.text.lstrip("#%/ "), delimiter)) for line in comments]
        full = [fields for _, fields in parted if len(fields) == width]
        wrong = next((p for p in parted if len(p[1]) > 1 and is_time_name(_named(p[1][0])[0])), None)
        if not full and wrong is not None:
            raise _miscounted(path, wrong[0], wrong[1], width)
    if not full:
        return names, units
    title = full[-1]
    if len(full) > 1 and is_unit_row(full[-1]):
        title, units = full[-2], [unit.strip("[]() ") for unit in full[-1]]
    for i, text in enumerate(title):
        names[i], unit = _named(text)
        units[i] = unit or units[i]
    return names, units


def _miscounted(path: Path, line: Line, fields: list[str], width: int) -> RecordingError:
    return RecordingError(
        f"{path}: line {line.number} names {len(fields)} columns, the lines of numbers have {width} fields: "
        "write decimal points, not commas, and a name for each column"
    )


def _split_quoted(text: str, delimiter: str) -> list[str]:
    if '"' not in text:
        return split_fields(text, delimiter)
    try:
        return [field.strip() for field in next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:  # a field longer than any title
        return [text]


def _parted_otherwise(text: str, width: int) -> list[str] | None:
    """Return the fields of a line of titles that is parted by something else than the numbers are."""
    parts = [_split_quoted(text, delimiter) for delimiter in DELIMITERS[:3]]
    parts.append([part.strip() for part in re.split(r"\s{2,}|\t", text)])
    return next((fields for fields in parts if len(fields) == width), None) if width > 1 else None


def _names_columns(fields: list[str], delimiter: str) -> bool:
    """Return whether a line seems to be one of titles, not prose."""
    if delimiter != " ":
        return len(fields) > 1
    return is_time_name(fields[0]) or any(field[:1] in "[(" for field in fields)


def _refuse_mixed(path: Path, header: list[tuple[Line, list[str]]], width: int, delimiter: str) -> None:
    """Refuse lines right above the numbers that are lines of numbers themselves, but for a field that is none.

    A first line may hold whole numbers: channels are called so.
    """
    wrong: tuple[Line, list[str]] | None = None
    for i, (line, fields) in reversed(list(enumerate(header))):
        numbers = [text for text in fields if is_number(text, delimiter != " ")]
        if len(fields) != width or not numbers or (i == 0 and all(text.isdigit() for text in numbers)):
            break
        wrong = line, fields
    if wrong is not None:
        line, fields = wrong
        column = next(i for i, text in enumerate(fields) if not is_number(text, delimiter != " "))
        raise RecordingError(f"{path}: line {line.number}, column {column + 1}: {fault_of(fields[column])}")


def _named(text: str) -> tuple[str, str]:
    """Return the name and the unit in a title such as ``a [g]``, ``a (g)``, ``a / g`` or ``a, g``."""
    text = " ".join(text.split())
    match = _UNIT.fullmatch(text)
    if match is not None:
        return match[1] or text, match[2].strip()
    match = _UNIT_AFTER.fullmatch(text)
    if match is not None and (is_time_name(match[1]) or _is_known(match[2])):
        return match[1], match[2]
    return text, ""


def _is_known(unit: str) -> bool:
    return is_time_unit(unit) or to_si(unit)[0] == "m/s2" or is_no_acceleration(unit)


def is_unit_row(fields: list[str]) -> bool:
    """Return whether a header line looks like units: all short, one of them known or with a slash or brackets."""
    bare = [text.strip("[]() ") for text in fields]
    return all(len(text) <= LONGEST_UNIT_TITLE for text in bare) and any(
        "/" in text
        or (is_time_unit(text) and len(text) > 1)
        or text in ("s", "g", "mg", "V", "mV", "N")
        or raw[:1] in "[("
        for raw, text in zip(fields, bare, strict=True)
        if raw
    )
