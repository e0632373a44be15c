"""Named arrays, as MATLAB files hold them, sorted into channels, times and a sampling rate."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.exchange.recording import FEWEST_SAMPLES, Columns, is_time_name, time_scale

MOST_CHANNELS = 64
"""Rows or columns of a matrix beyond which it is not taken for channels."""

_RATE_NAME = re.compile(r"fs|f_s|rate|(sample|sampling)_?(rate|freq|frequency)(_?hz)?|rate_?hz", re.IGNORECASE)
_STEP_NAME = re.compile(r"dt|delta_?t|(time|sample)_?step", re.IGNORECASE)


@dataclass(slots=True)
class NamedArrays:
    """What a walk through a file found: arrays and texts, each under its dotted name."""

    arrays: list[tuple[str, NDArray[np.float64]]] = field(default_factory=list)
    texts: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, values: NDArray[np.generic]) -> None:
        """Take in an array if it is of real numbers."""
        if values.dtype.kind in "fiu" and values.size:
            with np.errstate(over="ignore"):  # numbers wider than doubles become infinite, and are no samples
                self.arrays.append((name, np.asarray(values, dtype=np.float64)))


def sort_arrays(path: Path, found: NamedArrays) -> Columns:
    """Return the channels among the arrays: those of the length that most samples have.

    Raises
    ------
    RecordingError
        There is no array that could be a channel.
    """
    vectors: list[tuple[str, NDArray[np.float64]]] = []
    rate: float | None = None
    for name, values in found.arrays:
        leaf = name.rpartition(".")[2]
        squeezed = np.squeeze(values)
        if squeezed.ndim == 0:
            if _RATE_NAME.fullmatch(leaf):
                rate = float(squeezed)
            elif _STEP_NAME.fullmatch(leaf):
                rate = 1.0 / float(squeezed) if float(squeezed) > 0 else float(squeezed)
        elif squeezed.ndim == 1 and squeezed.size >= FEWEST_SAMPLES:
            vectors.append((name, squeezed))
        elif squeezed.ndim == 2 and max(squeezed.shape) >= FEWEST_SAMPLES and min(squeezed.shape) <= MOST_CHANNELS:
            rows = squeezed if squeezed.shape[0] <= squeezed.shape[1] else squeezed.T
            vectors += [(f"{name}({i})", row) for i, row in enumerate(rows)]
    if not vectors:
        raise RecordingError(f"{path}: is no recording: it holds no array of at least {FEWEST_SAMPLES} samples")
    lengths = [values.size for _, values in vectors]
    length = max(set(lengths), key=lambda n: (n * lengths.count(n), n))
    chosen = [(name, values) for name, values in vectors if values.size == length]
    times = [item for item in chosen if is_time_name(item[0].rpartition(".")[2])]
    channels = [item for item in chosen if item not in times] if len(times) != len(chosen) else []
    time = None
    time_name = "time"
    if times:
        time_name = times[0][0]
        unit = _unit(found.texts, time_name, 0, len(channels))
        with np.errstate(over="ignore", invalid="ignore"):
            time = np.ascontiguousarray(times[0][1]) * time_scale(time_name.rpartition(".")[2], unit)
    leaves = [name.rpartition(".")[2] for name, _ in channels]
    names = [leaf if leaves.count(leaf) == 1 else name for leaf, (name, _) in zip(leaves, channels, strict=True)]
    return Columns(
        names=names,
        units=[_unit(found.texts, name, i + 1, len(channels)) for i, (name, _) in enumerate(channels)],
        data=[np.ascontiguousarray(values) for _, values in channels],
        time=time,
        time_name=time_name.rpartition(".")[2],
        rate_hz=rate,
    )


def _unit(texts: dict[str, str], name: str, place: int, channels: int) -> str:
    """Return what a text ``units`` beside an array says of it: "time, all others", or one for each in order."""
    parent = name.rpartition(".")[0]
    for leaf in ("units", "unit"):
        text = texts.get(f"{parent}.{leaf}" if parent else leaf)
        if text is not None:
            parts = [part.strip() for part in text.split(",")]
            if len(parts) == channels + 1:
                return parts[place]
            if len(parts) == 2:
                return parts[min(place, 1)]
            if len(parts) == 1 and place:
                return parts[0]
    return ""
