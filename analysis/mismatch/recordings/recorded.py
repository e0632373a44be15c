"""A recording made ready: channels picked, filtered, decimated, cut into blocks to fit, to choose by, to hold out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from analysis.mismatch.policy import POLICY
from analysis.mismatch.recordings.outliers import put_right_before_thinning
from analysis.mismatch.recordings.thinning import RINGING, SPOILT, smoothed, thinned, thinning_factor
from analysis.mismatch.rig_description import DescribedRig
from analysis.session import AnalysisError
from daq.exchange import Recording
from daq.exchange.units import kind_of_motion, newtons, to_si
from sim_backend.arrangement import LOAD
from sim_backend.arrays import Real, Whole

FIT, CHOOSE, HELD, UNUSED = 0, 1, 2, -1
BLOCKS: Final = 24
PARTS: Final = np.array([FIT, CHOOSE, FIT, HELD])  # of neighbouring blocks
LONGEST_STRETCH = 20_000  # samples that are simulated in fitting; all of a recording is in the end
FILTER_ORDER = 4
EDGE_PERIODS = 3.0  # of the band's width that a filter's edge takes
SILENT: Final = 0.03  # of a decay's largest deflection: nothing has happened yet
LOUD_START, NEAR_LARGEST = 0.3, 0.7  # of a decay's largest deflection: it was ringing when it began, it is near that
ONE_SIDED: Final = 12  # last samples, not compared: there a lagging channel is interpolated from one side
FEWEST = 400  # samples that a recording must have


@dataclass(frozen=True, slots=True)
class WrongSample:
    """A sample of a channel that was put right: when it was taken, and by how many times the noise (rms) it was off."""

    channel: int
    time_s: float
    over_noise: float


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recording as it is simulated.

    Attributes
    ----------
    outputs, inputs
        (channels, n) and (inputs, n).
    start_s
        Time of the first sample in the file, s.
    band
        Second-order sections that the outputs went through, both ways; None without.
    edge
        Samples at either end that the filter spoils.
    part
        (n,) `FIT`, `CHOOSE`, `HELD` or `UNUSED`.
    block
        (n,) number of the block a sample belongs to.
    fitted
        What is simulated in fitting.
    stretches
        Held-out stretches by name.
    unit
        (channels,) that residuals are in: the channels' rms, or what is known of their noise.
    every
        Samples of the recording for one of these.
    rang_s
        How long the rig had been free before the first sample, as far as the recording tells.
    wrong
        Samples that were wrong by themselves.
    struck
        Samples left out as the rig was still struck after its largest deflection.
    measured
        Inputs as they were measured, where noise was taken off them.
    base
        (channels, n) the base's acceleration that was taken off channels that show it, too; None where none does.
    """

    source: str
    rate_hz: float
    start_s: float
    outputs: Real
    inputs: Real
    band: Real | None
    edge: int
    part: Whole
    block: Whole
    fitted: slice
    stretches: tuple[tuple[str, slice], ...]
    unit: Real
    every: int = 1
    rang_s: float = 0.0
    wrong: tuple[WrongSample, ...] = ()
    struck: int = 0
    measured: Real | None = None
    base: Real | None = None

    @property
    def samples(self) -> int:
        """Length."""
        return self.outputs.shape[1]

    @property
    def free(self) -> bool:
        """Whether nothing measured drives it."""
        return len(self.inputs) == 0

    def fitted_at(self, sample: int) -> Recorded:
        """Return it divided such that a sample is in a block that is fitted: it takes turns with a neighbouring one.

        Never with the first: the state in which the rig began is known there alone where it dies out soon.
        """
        if self.stretches or self.part[sample] in (FIT, UNUSED):
            return self
        block, moved = self.block[sample], self.part.copy()
        other = block - 1 if block > 1 else block + 1
        moved[(self.block == other) & (moved != UNUSED)] = self.part[sample]
        moved[(self.block == block) & (self.part != UNUSED)] = FIT
        return replace(self, part=moved)


def prepare(recording: Recording, rig: DescribedRig) -> Recorded:
    """Return a recording ready for this rig.

    Raises
    ------
    AnalysisError
        A channel is not there, the recording is too short or shows nothing, or the rig takes values from a session.
    """
    source, rate = recording.source, recording.rate_hz
    _refuse_what_sessions_tell(rig, source)
    _refuse_other_units(recording, rig)
    outputs = np.array([recording.data[_column(recording, s.channel)] for s in rig.seen])
    inputs = np.array([recording.data[_column(recording, d.channel)] for d in rig.drives])
    inputs = inputs.reshape(len(rig.drives), recording.data.shape[1])
    outputs = outputs - of_the_base(inputs, rig)
    if np.any(np.std(outputs, axis=1) == 0):
        raise AnalysisError(f"{source}: a channel of {rig.name} is constant: it shows nothing")
    n = outputs.shape[1]
    first = 0 if rig.from_s is None else round(rig.from_s * rate)
    last = n if rig.to_s is None else min(round(rig.to_s * rate), n)
    if last - first < FEWEST:
        between = "" if first == 0 and last == n else f" between the times that {rig.name} names (from_s, to_s)"
        raise AnalysisError(f"{source}: holds {max(last - first, 0)} samples{between}; a diagnosis needs {FEWEST}")
    if rig.band_hz is not None and 2 * EDGE_PERIODS / (rig.band_hz[1] - rig.band_hz[0]) >= (last - first) / rate:
        raise AnalysisError(
            f"{source}: the band of {rig.name}, {rig.band_hz[0]:g} to {rig.band_hz[1]:g} Hz, is too narrow for "
            f"{(last - first) / rate:.3g} s: its filter takes longer; give recording.band_hz in Hz, and wider"
        )
    band, edge, factor, rang = None, 0, 1, 0.0
    wrong: tuple[WrongSample, ...] = ()
    if rig.drives:
        outputs, inputs = outputs[:, first:last], inputs[:, first:last]
    else:
        if rig.band_hz is not None and rig.band_hz[1] >= 0.45 * rate:
            raise AnalysisError(
                f"{source}: the band of {rig.name} ends at {rig.band_hz[1]:g} Hz, too close to half the rate of "
                f"{rate:g} Hz"
            )
        outputs, factor, wrong = _put_right(outputs, rate, slice(first, last), rig.band_hz)
        # in what was sampled, as thinning out spreads what begins at once; in silence that was asked for, too
        silent = _silent_until(outputs[:, first:last])
        tapped, struck_s = rig.from_s is None or silent > 0, (first + silent) / rate
        if factor > 1:
            outputs = thinned(outputs, factor)
            rate, first, last = rate / factor, first // factor + RINGING, last // factor - RINGING
        if rig.band_hz is not None:
            band = signal.butter(FILTER_ORDER, rig.band_hz, "bandpass", fs=rate, output="sos")
            outputs = signal.sosfiltfilt(band, outputs, axis=1)
            edge = round(EDGE_PERIODS * rate / (rig.band_hz[1] - rig.band_hz[0]))
        if tapped:
            sought = 0 if rig.from_s is None else first
            free = sought + _free_from(outputs[:, sought:last])
            first = max(free + max(edge, SPOILT if factor > 1 else 0), first)
            rang = first / rate - struck_s
        outputs = outputs[:, first:last]
        inputs = inputs[:, : outputs.shape[1]]
        if outputs.shape[1] < FEWEST // 2 + 2 * edge:
            raise AnalysisError(f"{source}: too little is left of the recording after its largest deflection")
    rows = np.ascontiguousarray(outputs), np.ascontiguousarray(inputs)
    found = divided(source, (rate, first / rate), rows, (band, edge), rig)
    base = of_the_base(rows[1], rig) if any(s.absolute for s in rig.seen) else None
    return replace(found, every=factor, rang_s=rang, wrong=wrong, base=base)


def of_the_base(inputs: Real, rig: DescribedRig) -> Real:
    """Return (c, n) the acceleration of the base, from inputs (inputs, n), in the channels that show it as well."""
    gains = {p.name: p.value for p in rig.arrangement.parameters}
    share = np.array([gains[s.gain] if s.absolute else 0.0 for s in rig.seen])
    base = np.zeros(inputs.shape[1])
    for drive, row in zip(rig.drives, inputs, strict=True):
        base += gains[drive.gain] * row if drive.base and np.any(share) else 0.0  # else the gain may be unknown
    return np.outer(share, base)


def _refuse_what_sessions_tell(rig: DescribedRig, source: str) -> None:
    arrangement = rig.arrangement
    told = [p.name for p in arrangement.parameters if p.name in rig.header or p.scope == LOAD]
    if rig.preload_n <= 0:
        told += [f"preload of {e.name}" for e in arrangement.elements if e.preload]
    if told:
        raise AnalysisError(
            f"{source}: is not a session, and {rig.name} takes from one its {', '.join(told)}; "
            "give values in the rig file"
        )


def _refuse_other_units(recording: Recording, rig: DescribedRig) -> None:
    """Refuse a recording that says another unit of a channel than the rig file; what either leaves open is taken."""
    units, source = recording.units or (recording.unit,) * len(recording.names), recording.source
    for seen in rig.seen:
        unit, shows = units[_column(recording, seen.channel)], seen.sensor.quantity
        kind = "force" if newtons(unit) is not None else kind_of_motion(unit)
        if kind and kind != shows:
            raise AnalysisError(
                f"{source}: channel {seen.channel} is in {unit}, a unit of {kind}, and the rig file says that it shows "
                f"{shows}; correct 'shows' of that sensor, or the title in the recording"
            )
        said, factor = to_si(seen.unit)
        if kind and seen.unit and (said.replace("μ", "µ") != unit.replace("μ", "µ") or factor != 1.0):
            converted = ", to which accelerations in other units are converted," if unit == "m/s2" else ""
            raise AnalysisError(
                f"{source}: channel {seen.channel} is read in {unit}{converted} and the rig file says {seen.unit}; "
                f"write 'unit: {unit}', and a gain if the rig is not in it"
            )
    for drive in rig.drives:
        unit = units[_column(recording, drive.channel)]
        if newtons(unit) is not None if drive.base else kind_of_motion(unit):
            raise AnalysisError(
                f"{source}: channel {drive.channel} is in {unit}, and the rig file says that it is "
                f"{'the acceleration of the base' if drive.base else 'a force'}; correct the input"
            )


def _column(recording: Recording, channel: str | int) -> int:
    if isinstance(channel, str) and channel in recording.names:
        return recording.names.index(channel)
    if isinstance(channel, int) and 0 <= channel < len(recording.names):
        return channel
    raise AnalysisError(f"{recording.source}: has no channel {channel}; it holds {', '.join(recording.names[:20])}")


def _put_right(
    outputs: Real, rate: float, at: slice, band: tuple[float, float] | None
) -> tuple[Real, int, tuple[WrongSample, ...]]:
    """Return channels (c, n) and by what they may be thinned out; if at all, without samples wrong by themselves."""
    factor = thinning_factor(outputs[:, at], rate, band, FEWEST)
    if factor == 1:
        return outputs, 1, ()
    begun = at.start + _free_from(smoothed(outputs[:, at], factor)) + RINGING * factor
    outputs, odd = put_right_before_thinning(outputs, factor, slice(begun, at.stop), POLICY.level)
    factor = thinning_factor(outputs[:, at], rate, band, FEWEST)  # in one wrong sample noise is lost
    return outputs, factor, tuple(WrongSample(w.channel, w.sample / rate, w.over_noise) for w in odd)


def _loudness(outputs: Real) -> Real:
    """Return (n,) how loud the loudest channel (c, n) is at each sample, over its own largest value."""
    return np.asarray(np.abs(outputs / np.abs(outputs).max(axis=1, keepdims=True)).max(axis=0), np.float64)


def _silent_until(outputs: Real) -> int:
    """Return the last silent sample before a recording became loud: that of the impact; 0 where none was."""
    level = _loudness(outputs)
    silent = np.flatnonzero(level[: int(np.argmax(level >= LOUD_START))] < SILENT)
    return int(silent[-1]) if silent.size else 0


def _free_from(outputs: Real) -> int:
    """Return the sample after the largest deflection.

    Modes that beat may be largest long after a recording began in mid-decay: then it is free from where it first comes
    near to that.
    """
    level = _loudness(outputs)
    begun = np.any(level[: max(level.size // 50, 1)] >= LOUD_START)
    return int(np.argmax(level >= NEAR_LARGEST if begun else level)) + 1


def divided(
    source: str,
    clock: tuple[float, float],
    rows: tuple[Real, Real],
    filtered: tuple[Real | None, int],
    rig: DescribedRig,
) -> Recorded:
    """Return a recording cut into parts: ``clock`` is rate (Hz) and start (s), ``filtered`` the band and its edge."""
    (rate, start), (outputs, inputs), (band, edge) = clock, rows, filtered
    n = outputs.shape[1]
    part = np.full(n, UNUSED, np.int64)
    block = np.arange(n) * BLOCKS // n
    stretches = []
    if rig.held_out:
        held = np.zeros(n, bool)
        for s in rig.held_out:
            first, last = (round(min(max((edge_s - start) * rate, 0.0), float(n))) for edge_s in (s.from_s, s.to_s))
            at = slice(first, last)
            if at.stop <= at.start:
                raise AnalysisError(f"{source}: the held-out stretch {s.name!r} lies outside the recording")
            held[at] = True
            stretches.append((s.name, at))
        fitted = _longest(~held)
        if fitted.stop - fitted.start < FEWEST // 2:
            raise AnalysisError(f"{source}: the held-out stretches of {rig.name} leave too little to fit")
        part[held] = HELD
        inside = np.arange(fitted.stop - fitted.start) * BLOCKS // (fitted.stop - fitted.start)
        part[fitted] = np.where(inside % 3 == 2, CHOOSE, FIT)
        block[fitted] = inside
    else:
        fitted = slice(0, n) if not inputs.size else _strongest(outputs)
        block = (np.arange(n) - fitted.start) * BLOCKS // (fitted.stop - fitted.start)
        part[:] = PARTS[block % len(PARTS)]
        part[: fitted.start] = part[fitted.stop :] = HELD
    if edge:
        part[:edge] = UNUSED
        part[n - edge :] = UNUSED
    for at in (fitted,) if stretches else (fitted, slice(0, n)):
        part[at.stop - ONE_SIDED : at.stop] = UNUSED
    unit = rms(outputs)
    return Recorded(source, rate, start, outputs, inputs, band, edge, part, block, fitted, tuple(stretches), unit)


def _strongest(outputs: Real) -> slice:
    """Return the stretch, no longer than what is simulated in fitting, in which most happens."""
    n = outputs.shape[1]
    size = min(n, LONGEST_STRETCH)
    grown = np.concatenate([[0.0], np.cumsum(np.sum((outputs - outputs.mean(axis=1, keepdims=True)) ** 2, axis=0))])
    starts = np.unique(np.append(np.arange(0, n - size + 1, max(size // 4, 1)), n - size))
    first = int(starts[np.argmax(grown[starts + size] - grown[starts])])
    return slice(first, first + size)


def _longest(free: NDArray[np.bool_]) -> slice:
    """Return the longest run of True, cut to what is simulated in fitting."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], free.astype(np.int8), [0]])))
    runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    first, last = max(runs, key=lambda r: r[1] - r[0], default=(0, 0))
    return slice(first, min(last, first + LONGEST_STRETCH))


def level(recorded: Recorded) -> Real:
    """Return (channels,) the rms of each channel about its mean, never zero."""
    return rms(recorded.outputs)


def rms(rows: Real) -> Real:
    """Return (channels,) the rms of each channel (channels, n) about its mean, never zero."""
    return np.maximum(np.std(rows, axis=1), math.ulp(1.0))
