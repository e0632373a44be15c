"""Universal files: the time responses among their data sets 58."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pyuff

from daq.errors import RecordingError
from daq.exchange.recording import Columns

BEGINS = re.compile(rb"\s*-1[ \t]*\r?\n\s*\d+")
"""How a universal file begins: a line with -1, then the number of a data set."""

_MARK = re.compile(rb"^    -1[ \t]*\r?$", re.MULTILINE)
TIME_RESPONSE = (0, 1)
"""Function types of data set 58 that are samples against time: general, and time response."""


def read_universal(path: Path, content: bytes) -> Columns:
    """Return the time responses in a universal file; they have to be alike in length and sampling.

    Raises
    ------
    RecordingError
        The file is damaged or truncated, holds no time response, or they are unlike.
    """
    sets = _read_sets(path, content)
    columns = Columns([], [], [])
    times: list[np.ndarray[Any, np.dtype[np.float64]]] = []
    for number, block in sets:
        values, time = np.asarray(block["data"]), np.asarray(block["x"], dtype=np.float64)
        claimed = int(block["num_pts"])
        if values.size != claimed or time.size != claimed:
            text = f"claims {claimed} values but holds {values.size}: the file is truncated or damaged"
            raise RecordingError(f"{path}: data set {number} {text}")
        columns.data.append(np.ascontiguousarray(values, dtype=np.float64))
        columns.units.append(_text(block.get("ordinate_axis_units_lab")))
        columns.names.append(_text(block.get("id1")) or _text(block.get("rsp_ent_name")) or f"set{number}")
        times.append(time)
    first = times[0]
    for (number, _), time in zip(sets[1:], times[1:], strict=True):
        if time.size != first.size:
            raise RecordingError(f"{path}: data set {number} has {time.size} samples, the first one {first.size}")
        if not np.allclose(time - time[:1], first - first[:1], rtol=1e-6, atol=0.0):
            raise RecordingError(f"{path}: data set {number} is sampled at another rate than the first one")
    columns.time, columns.time_name = first, "abscissa"
    return columns


def _read_sets(path: Path, content: bytes) -> list[tuple[int, dict[str, Any]]]:
    """Return the real time responses with their numbers, from 1."""
    if len(_MARK.findall(content)) % 2 and b"58b" not in content:
        raise RecordingError(f"{path}: is truncated: its last data set does not end")
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            file = pyuff.UFF(str(path))
            types = [int(kind) for kind in np.atleast_1d(file.get_set_types())]
            blocks = [(i + 1, file.read_sets(i)) for i, kind in enumerate(types) if kind == 58]
            sets = [
                (number, block)
                for number, block in blocks
                if block["func_type"] in TIME_RESPONSE and not np.iscomplexobj(block["data"])
            ]
            for _, block in sets:
                int(block["num_pts"]), np.asarray(block["x"], dtype=np.float64)
    except Exception as error:  # pyuff raises plain Exception, and whatever its parser stumbles over
        raise RecordingError(f"{path}: is a damaged or truncated universal file") from error
    if not sets:
        raise RecordingError(f"{path}: holds no time response (data set 58); its data sets are {types[:20]}")
    return sets


def _text(label: object) -> str:
    text = str(label or "").strip()
    return "" if text.upper() == "NONE" else text
