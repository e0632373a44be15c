"""Named arrays, as MATLAB files hold them, sorted into channels, times and a sampling rate."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.exchange.recording import FEWEST_SAMPLES, RATE_TOLERANCE, Columns
from daq.exchange.units import is_time_name, time_scale

MOST_CHANNELS = 64
"""Rows or columns of a matrix beyond which it is not taken for channels."""

SAME_START = 0.5
"""Samples by which two columns of times may begin apart to be those of one recording."""

_RATE_NAME = re.compile(r"(?:fs|f_s|rate|(?:sample|sampling)_?(?:rate|freq|frequency))(_?k?hz)?", re.IGNORECASE)
_STEP_NAME = re.compile(r"dt|delta_?t|(time|sample)_?step", re.IGNORECASE)


@dataclass(slots=True)
class NamedArrays:
    """What a walk through a file found: arrays and texts, each under its dotted name.

    Attributes
    ----------
    units
        Units that are written at an array itself, by its name.
    left_out
        Arrays that are not of real numbers, by name: what they are of, and how many values they hold.
    """

    arrays: list[tuple[str, NDArray[np.float64]]] = field(default_factory=list)
    texts: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, tuple[str, int]] = field(default_factory=dict)

    def leave_out(self, name: str, what: str, size: int) -> None:
        """Note an array that is not taken in."""
        self.left_out[name] = what, size

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
    skipped = [f"{name} ({what})" for name, (what, size) in found.left_out.items() if size >= FEWEST_SAMPLES]
    for name, values in found.arrays:
        squeezed = np.squeeze(values)
        if squeezed.ndim == 1 and squeezed.size >= FEWEST_SAMPLES:
            vectors.append((name, squeezed))
        elif squeezed.ndim == 2 and max(squeezed.shape) >= FEWEST_SAMPLES and min(squeezed.shape) <= MOST_CHANNELS:
            rows = squeezed if squeezed.shape[0] <= squeezed.shape[1] else squeezed.T
            vectors += [(f"{name}({i})", row) for i, row in enumerate(rows)]
        elif squeezed.size >= FEWEST_SAMPLES:
            skipped.append(f"{name} ({' by '.join(map(str, squeezed.shape))} values)")
    rate = _rate(path, found)
    if not vectors:
        hint = f"; left out is {skipped[0]:.100}" if skipped else ""
        raise RecordingError(
            f"{path}: is not a recording: it holds no array of at least {FEWEST_SAMPLES} samples{hint}"
        )
    lengths = [values.size for _, values in vectors]
    length = max(set(lengths), key=lambda n: (n * lengths.count(n), n))
    chosen = [(name, values) for name, values in vectors if values.size == length]
    times = [item for item in chosen if is_time_name(item[0].rpartition(".")[2])]
    channels = [item for item in chosen if item not in times] if len(times) != len(chosen) else []
    skipped += [f"{name} ({values.size} samples, not {length})" for name, values in vectors if values.size != length]
    time = None
    time_name = times[0][0] if times else "time"
    if times:
        time = _seconds(path, found, times[0], len(channels))
        for other in times[1:]:
            _refuse_unlike(path, (time_name, time), (other[0], _seconds(path, found, other, len(channels))))
    leaves = [name.rpartition(".")[2] for name, _ in channels]
    names = [leaf if leaves.count(leaf) == 1 else name for leaf, (name, _) in zip(leaves, channels, strict=True)]
    return Columns(
        names=names,
        units=[
            found.units.get(name) or _unit(found.texts, name, i + 1, len(channels))
            for i, (name, _) in enumerate(channels)
        ],
        data=[np.ascontiguousarray(values) for _, values in channels],
        time=time,
        time_name=time_name.rpartition(".")[2],
        rate_hz=rate,
        skipped=skipped,
    )


def _rate(path: Path, found: NamedArrays) -> float | None:
    """Return the sampling rate, Hz, that numbers of a file say, or None.

    Raises
    ------
    RecordingError
        They contradict each other, or are no single real number.
    """
    said: list[tuple[str, float]] = []
    for name, values in found.arrays:
        rate = _RATE_NAME.fullmatch(name.rpartition(".")[2])
        step = _STEP_NAME.fullmatch(name.rpartition(".")[2])
        if (rate is None and step is None) or values.size >= FEWEST_SAMPLES:
            continue
        if values.size != 1:
            raise RecordingError(f"{path}: {name} holds {values.size} values, expected one sampling rate")
        value = float(values.reshape(-1)[0])
        if rate is not None:
            said.append((name, value * (1e3 if (rate[1] or "").lower().endswith("khz") else 1.0)))
        else:
            said.append((name, 1.0 / value if value > 0 else value))
    for name, (what, _) in found.left_out.items():
        leaf = name.rpartition(".")[2]
        if _RATE_NAME.fullmatch(leaf) or _STEP_NAME.fullmatch(leaf):
            raise RecordingError(f"{path}: {name} is {what}, expected a real sampling rate")
    for name, rate_hz in said[1:]:
        if not abs(rate_hz - said[0][1]) <= RATE_TOLERANCE * abs(said[0][1]) and rate_hz != said[0][1]:
            raise RecordingError(
                f"{path}: the sampling rate is contradictory: {said[0][0]} says {said[0][1]:g} Hz, "
                f"{name} {rate_hz:g} Hz"
            )
    return said[0][1] if said else None


def _seconds(
    path: Path, found: NamedArrays, times: tuple[str, NDArray[np.float64]], channels: int
) -> NDArray[np.float64]:
    name, values = times
    unit = found.units.get(name, "").partition(" since ")[0] or _unit(found.texts, name, 0, channels)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.ascontiguousarray(values) * time_scale(path, name.rpartition(".")[2], unit)


@np.errstate(over="ignore", invalid="ignore")
def _refuse_unlike(path: Path, first: tuple[str, NDArray[np.float64]], other: tuple[str, NDArray[np.float64]]) -> None:
    """Refuse two columns of times that are not those of one recording."""
    step = abs(float(first[1][-1] - first[1][0])) / (first[1].size - 1)
    if not float(np.abs(other[1] - first[1]).max()) <= SAME_START * step:
        raise RecordingError(
            f"{path}: {first[0]} and {other[0]} are both times, and they differ: put one recording into a file"
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
