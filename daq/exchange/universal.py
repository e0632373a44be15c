"""Universal files: the time responses among their data sets 58."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pyuff

from daq.errors import RecordingError
from daq.exchange.recording import Columns
from daq.exchange.units import is_gravity, time_scale, to_si

BEGINS = re.compile(rb"\s*-1[ \t]*\r?\n\s*\d+")
"""How a universal file begins: a line with -1, then the number of a data set."""

_MARK = re.compile(rb"^    -1[ \t]*\r?$", re.MULTILINE)
TIME_RESPONSE = (0, 1)
"""Function types of data set 58 that are samples against time: general, and time response."""

SAME_START = 0.5
"""Samples by which two data sets may begin apart to be channels of one recording."""

SAME_UNIT = 1e-6
"""Relative difference of two factors between units that is put down to the digits they are written with."""

RATE_LINE = "sampling rate: "
"""How the third line of a data set 58 begins where this program wrote it: the step between samples has 6 digits."""

SAME_RATE = 1e-5
"""Relative difference of a rate from the step beside it that is put down to the step's digits."""

_KINDS = {8: ("m", "length"), 11: ("m/s", "length"), 12: ("m/s2", "length"), 13: ("N", "force")}
"""Unit of a kind of data (the specific data type of data set 58), and which units of data set 164 it is written in."""


def read_universal(path: Path, content: bytes) -> Columns:
    """Return the time responses in a universal file; they have to be alike in length and sampling.

    Raises
    ------
    RecordingError
        The file is damaged or truncated, holds no time response, or they are unlike.
    """
    sets, others, scales = _read_sets(path, content)
    columns = Columns([], [], [], skipped=others)
    times: list[np.ndarray[Any, np.dtype[np.float64]]] = []
    for number, block in sets:
        values, time = np.asarray(block["data"]), np.array(block["x"], dtype=np.float64)
        claimed = int(block["num_pts"])
        if values.size != claimed or time.size != claimed:
            text = f"claims {claimed} values but holds {values.size}: the file is truncated or damaged"
            raise RecordingError(f"{path}: data set {number} {text}")
        unit, scale = _unit(path, number, block, scales)
        columns.data.append(np.ascontiguousarray(values, dtype=np.float64) / scale)
        columns.units.append(unit)
        time *= time_scale(path, "abscissa", _text(block.get("abscissa_axis_units_lab")))
        columns.names.append(_text(block.get("id1")) or _text(block.get("rsp_ent_name")) or f"set{number}")
        times.append(time)
    first = times[0]
    for (number, _), time in zip(sets[1:], times[1:], strict=True):
        if time.size != first.size:
            raise RecordingError(f"{path}: data set {number} has {time.size} samples, the first one {first.size}")
        if not np.allclose(time - time[:1], first - first[:1], rtol=1e-6, atol=0.0):
            raise RecordingError(f"{path}: data set {number} is sampled at another rate than the first one")
        step = abs(float(first[-1] - first[0])) / max(first.size - 1, 1)
        if first.size and not abs(float(time[0] - first[0])) <= SAME_START * step:
            raise RecordingError(
                f"{path}: data set {number} begins {time[0] - first[0]:g} s after the first one: "
                "they are no channels of one recording"
            )
    columns.rate_hz = _written_rate([block for _, block in sets], first)
    columns.time, columns.time_name = None if columns.rate_hz else first, "abscissa"
    return columns


def _written_rate(blocks: list[dict[str, Any]], time: np.ndarray[Any, np.dtype[np.float64]]) -> float | None:
    """Return the rate, Hz, that this program wrote beside each data set, if it is the one of the abscissa."""
    lines = {_text(block.get("id3")) for block in blocks}
    found = re.fullmatch(re.escape(RATE_LINE) + r"([0-9.]{1,25}(?:e[+-]?\d{1,3})?) Hz", lines.pop())
    if lines or found is None or time.size < 2 or found[1].count(".") > 1 or not found[1][0].isdigit():
        return None
    rate, span = float(found[1]), float(time[-1] - time[0])
    return rate if abs(rate * span - (time.size - 1)) <= SAME_RATE * (time.size - 1) else None


def _unit(path: Path, number: int, block: dict[str, Any], scales: dict[str, float]) -> tuple[str, float]:
    """Return the unit of a data set, and what its values are divided by: its own label, else what data set 164 says."""
    label, kind = _text(block.get("ordinate_axis_units_lab")), int(block.get("ordinate_spec_data_type") or 0)
    if not scales or (label and to_si(label)[0] != "m/s2"):
        return label, 1.0
    length = scales["length"]
    if label:
        factor = to_si(label)[1]
        if not is_gravity(label) and abs(factor * length - 1.0) > SAME_UNIT:
            raise RecordingError(
                f"{path}: data set {number} is in {label:.40}, but data set 164 says {length:g} units of length to a "
                "metre: its unit is contradictory"
            )
        return label, 1.0
    if kind in _KINDS:
        unit, measure = _KINDS[kind]
        return unit, scales[measure]
    if abs(length - 1.0) > SAME_UNIT:
        raise RecordingError(
            f"{path}: data set {number} does not say what it measures, and data set 164 says {length:g} units of "
            "length to a metre: give it the label of its unit"
        )
    return "", 1.0


def _read_sets(path: Path, content: bytes) -> tuple[list[tuple[int, dict[str, Any]]], list[str], dict[str, float]]:
    """Return the real time responses with their numbers, from 1; what was left out; and the units of data set 164."""
    if len(_MARK.findall(content)) % 2 and b"58b" not in content:
        raise RecordingError(f"{path}: is truncated: its last data set does not end")
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            file = pyuff.UFF(str(path))
            types = [int(kind) for kind in np.atleast_1d(file.get_set_types())]
            blocks = [(i + 1, file.read_sets(i)) for i, kind in enumerate(types) if kind == 58]
            responses = [(number, block) for number, block in blocks if block["func_type"] in TIME_RESPONSE]
            sets = [(number, block) for number, block in responses if not np.iscomplexobj(block["data"])]
            others = [f"data set {n} (complex)" for n, block in responses if np.iscomplexobj(block["data"])]
            others += _left_out(types, blocks)
            units = [file.read_sets(i) for i, kind in enumerate(types) if kind == 164]
            scales = [{measure: float(block[measure]) for measure in ("length", "force")} for block in units]
            for _, block in sets:
                int(block["num_pts"]), np.asarray(block["x"], dtype=np.float64)
    except Exception as error:  # pyuff raises plain Exception, and whatever its parser stumbles over
        raise RecordingError(f"{path}: is a damaged or truncated universal file") from error
    if not sets:
        raise RecordingError(f"{path}: holds no time response (data set 58), but {_instead(types, blocks)}")
    if any(not 0 < value < math.inf for scale in scales for value in scale.values()):
        raise RecordingError(f"{path}: its data set 164 says units that are none")
    if any(scale != scales[0] for scale in scales):
        raise RecordingError(f"{path}: its data sets 164 say different units")
    return sets, others, scales[0] if scales else {}


_FUNCTIONS = {
    2: "auto spectrum",
    3: "cross spectrum",
    4: "frequency response",
    5: "transmissibility",
    6: "coherence",
    7: "autocorrelation",
    8: "cross-correlation",
    9: "power spectral density",
    12: "spectrum",
}
"""Function types of data set 58 that are no samples against time."""

FROM_TIME = (
    "modes are identified from the samples themselves, so have the program that measured them write its time records "
    "(data sets 58 of function type 1), or as CSV or MAT"
)


def _left_out(types: list[int], blocks: list[tuple[int, dict[str, Any]]]) -> list[str]:
    """Return what stands beside the time responses, an item for each kind, with the numbers of its data sets."""
    found: dict[str, list[int]] = {}
    for number, block in blocks:
        if block["func_type"] not in TIME_RESPONSE:
            found.setdefault(_FUNCTIONS.get(int(block["func_type"]), "other function"), []).append(number)
    why = "modes are identified from time records alone"
    said = [f"{_counted(kind, numbers)} ({why})" for kind, numbers in found.items()]
    shapes = [number for number, kind in enumerate(types, start=1) if kind == 55]
    return said + ([f"{_counted('mode shape', shapes)} (modes are identified anew)"] if shapes else [])


def _counted(kind: str, numbers: list[int]) -> str:
    """Return how many there are of a kind, and in which data sets."""
    first, last = numbers[0], numbers[-1]
    if len(numbers) == 1:
        return f"a {kind}, data set {first}"
    joined = "to" if last - first == len(numbers) - 1 else "..."
    return f"{len(numbers)} x {kind}, data sets {first} {joined} {last}"


def _instead(types: list[int], blocks: list[tuple[int, dict[str, Any]]]) -> str:
    """Return what a file without a time response holds, and what to do about it."""
    kinds = [_FUNCTIONS.get(int(block["func_type"]), "other function") for _, block in blocks]
    kinds += ["mode shape" for kind in types if kind == 55]
    if not kinds:
        return f"data sets {', '.join(map(str, types[:20])) or 'of no kind'}"
    counted = [f"{kinds.count(kind)} x {kind}" for kind in dict.fromkeys(kinds)]
    return f"{', '.join(counted)}: {FROM_TIME}"


def _text(label: object) -> str:
    text = str(label or "").strip()
    return "" if text.upper() == "NONE" else text
