"""What any file format yields, and the checks that make a recording of it: rate, channels, units, finite samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.exchange.units import to_si
from daq.limits import LARGEST_ARRAY

FEWEST_SAMPLES = 16
"""Samples below which a file is not taken for a recording."""

MOST_CHANNELS = 1000
"""Channels beyond which a file is not a recording of a rig."""

RATE_TOLERANCE = 0.005
"""Relative difference between a given sampling rate and the file's beyond which they contradict each other."""

UNIFORMITY = 0.02
"""Departure from even spacing, in steps, that is put down to rounding in the program that wrote the times."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording of any kind.

    Attributes
    ----------
    data
        (c, n) samples, all finite.
    rate_hz
        Sampling rate, Hz.
    names
        A name a channel.
    unit
        Unit of all channels, ``"m/s2"`` if it was said to be that or g; empty where unknown or mixed.
    source
        The file it came from.
    units
        A unit a channel, as `unit`; empty where nothing is known of any.
    left_out
        What in the file looks like a channel but is none of this recording, each with the reason.
    decay_from_s
        Time in it from which on it is a free decay, s; None: not said.
    """

    data: NDArray[np.float64]
    rate_hz: float
    names: tuple[str, ...]
    unit: str
    source: str
    units: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    decay_from_s: float | None = None


@dataclass(slots=True)
class Columns:
    """What a reader found: channels of one length, and what it knows of their time.

    Attributes
    ----------
    names, units, data
        A name, a unit (empty if unknown) and (n,) samples a channel.
    time
        (n,) times, s, or None; ``time_name`` is what the file calls them.
    rate_hz
        Sampling rate by the file itself, or None.
    skipped
        What looks like a channel and was left out, each with the reason.
    gap
        A line without numbers in the midst of numbers, 0 if there is none: only times say whether samples are missing.
    """

    names: list[str]
    units: list[str]
    data: list[NDArray[np.float64]]
    time: NDArray[np.float64] | None = None
    time_name: str = "time"
    rate_hz: float | None = None
    skipped: list[str] = field(default_factory=list)
    gap: int = 0


@np.errstate(over="ignore", invalid="ignore")
def is_even(time: NDArray[np.float64]) -> bool:
    """Return whether ``time`` (n,) increases by even steps, up to rounding."""
    return _first_uneven(time) is None


def _resolution(time: NDArray[np.float64]) -> float:
    """Return the place of the last decimal that the times carry, s."""
    largest = float(np.abs(time).max())
    for decimals in range(13):
        scaled = time * 10.0**decimals
        if np.abs(scaled - np.round(scaled)).max() <= 1e-9 * max(1.0, largest * 10.0**decimals):
            return 10.0**-decimals if decimals or largest < 2**53 else largest
    return 4e-16 * largest


def _first_uneven(time: NDArray[np.float64]) -> int | None:
    """Return the first sample whose step is wrong, None where all are even."""
    steps = np.diff(time)
    if not (steps > 0).all():
        return int(np.argmax(steps <= 0)) + 1
    step = (time[-1] - time[0]) / (time.size - 1)
    resolution = _resolution(time)
    line = time[0] + step * np.arange(time.size)
    slack = UNIFORMITY * step + (resolution if resolution < step else 0.0) + 1e-14 * abs(float(time[-1]))
    if np.abs(time - line).max() <= slack and steps.max() <= 1.9 * step:
        return None
    return int(np.argmax(np.abs(steps - np.median(steps)))) + 1


@np.errstate(over="ignore", invalid="ignore")
def rate_of(path: Path, time: NDArray[np.float64], name: str) -> float:
    """Return the sampling rate behind a column of times, s.

    Raises
    ------
    RecordingError
        The times are not finite, not increasing, or not even; the sample is named. Or they are too close together, or
        too far apart, for any rate.
    """
    finite = np.isfinite(time)
    if not finite.all():
        raise RecordingError(f"{path}: column {name} holds no number at sample {int(np.argmin(finite))}")
    wrong = _first_uneven(time)
    if wrong is not None:
        step, usual = time[wrong] - time[wrong - 1], float(np.median(np.diff(time)))
        if step < 0:
            raise RecordingError(f"{path}: column {name} runs backwards: at sample {wrong} it steps by {step:g} s")
        raise RecordingError(
            f"{path}: column {name} is not evenly spaced: "
            f"at sample {wrong} it steps by {step:g} s instead of {usual:g} s"
        )
    span = float(time[-1] - time[0])
    rate = (time.size - 1) / span
    if not 0 < rate < math.inf:
        raise RecordingError(f"{path}: column {name} says a sampling rate of {rate:g} Hz, which no recorder has")
    doubt = rate * (min(_resolution(time), span) / span + 1e-9)
    nearest = float(round(rate))
    return nearest if nearest > 0 and abs(rate - nearest) <= doubt else rate


def make_recording(
    path: Path,
    columns: Columns,
    rate_hz: float | None,
    channels: Sequence[str | int] | None,
    unit: str | None,
) -> Recording:
    """Check what a reader found and make a recording of it.

    Raises
    ------
    RecordingError
        A channel is not there or holds a NaN, or the rate is missing, wrong or contradictory.
    """
    if not columns.data:
        raise RecordingError(f"{path}: holds no channel of samples")
    if len(columns.data) > MOST_CHANNELS:
        raise RecordingError(f"{path}: holds {len(columns.data)} channels, more than this program takes")
    samples = columns.data[0].size
    if samples < FEWEST_SAMPLES:
        raise RecordingError(f"{path}: holds only {samples} samples, expected at least {FEWEST_SAMPLES}")
    if samples * len(columns.data) > LARGEST_ARRAY:
        raise RecordingError(f"{path}: holds more than {LARGEST_ARRAY} values, more than this program takes")
    names = _unique(columns.names)
    chosen = list(range(len(names))) if channels is None else [_index(path, names, c) for c in channels]
    if not chosen:
        raise RecordingError(f"{path}: no channel was asked for; it holds {_list(names)}")
    twice = next((i for place, i in enumerate(chosen) if i in chosen[:place]), None)
    if twice is not None:
        raise RecordingError(f"{path}: channel {names[twice]} is asked for twice")
    if columns.gap and columns.time is None:
        raise RecordingError(
            f"{path}: line {columns.gap} holds no numbers but stands among numbers: "
            "take it out if no sample is missing there"
        )
    rate = _settle_rate(path, columns, rate_hz)
    data, units = np.empty((len(chosen), samples)), []
    for row, i in zip(data, chosen, strict=True):
        finite = np.isfinite(columns.data[i])
        if not finite.all():
            sample = int(np.argmin(finite))
            what = "a NaN" if np.isnan(columns.data[i][sample]) else "an infinite value"
            raise RecordingError(f"{path}: channel {names[i]} holds {what} at sample {sample}")
        said, factor = to_si(columns.units[i] if unit is None else unit)
        units.append(said)
        with np.errstate(over="ignore"):
            np.multiply(columns.data[i], factor, out=row)
    if not np.isfinite(data).all():
        raise RecordingError(f"{path}: holds values too large to be accelerations")
    common = units[0] if len(set(units)) == 1 else ""
    taken = tuple(names[i] for i in chosen)
    return Recording(data, rate, taken, common, str(path), tuple(units), tuple(columns.skipped))


def _settle_rate(path: Path, columns: Columns, given: float | None) -> float:
    if given is not None and not (math.isfinite(given) and given > 0):
        raise RecordingError(f"{path}: the sampling rate given is {given:g} Hz, expected above 0")
    found: list[tuple[str, float]] = [] if given is None else [("the rate given", float(given))]
    if columns.time is not None:
        found.append((f"column {columns.time_name}", rate_of(path, columns.time, columns.time_name)))
    if columns.rate_hz is not None:
        if not (math.isfinite(columns.rate_hz) and columns.rate_hz > 0):
            raise RecordingError(f"{path}: says a sampling rate of {columns.rate_hz:g} Hz, expected above 0")
        found.append(("its header", columns.rate_hz))
    if not found:
        raise RecordingError(f"{path}: says neither times nor a sampling rate: give the rate in Hz (--rate)")
    for who, rate in found[1:]:
        if abs(rate - found[0][1]) > RATE_TOLERANCE * found[0][1]:
            raise RecordingError(
                f"{path}: the sampling rate is contradictory: {found[0][0]} says {found[0][1]:g} Hz, {who} {rate:g} Hz"
            )
    return found[0][1]


def _unique(names: list[str]) -> list[str]:
    """Return the names with numbers added where two are alike or one is empty."""
    result: list[str] = []
    for i, name in enumerate(names):
        base = name.strip() or f"channel{i}"
        unique, n = base, 2
        while unique in result:
            unique, n = f"{base}_{n}", n + 1
        result.append(unique)
    return result


def _index(path: Path, names: list[str], channel: str | int) -> int:
    if isinstance(channel, str) and channel in names:
        return names.index(channel)
    if isinstance(channel, int) or (channel.isascii() and channel.isdigit() and len(channel) < 9):
        number = int(channel)
        if 0 <= number < len(names):
            return number
    raise RecordingError(f"{path}: has no channel {channel}; it holds {_list(names)}")


def _list(names: list[str]) -> str:
    shown = ", ".join(f"{i}: {name:.40}" for i, name in enumerate(names[:20]))
    return shown + (f" and {len(names) - 20} more" if len(names) > 20 else "")
