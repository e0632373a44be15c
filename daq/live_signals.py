"""The stream of both accelerometers as it is looked at live: trace, spectrum and levels, with bounded work a look.

What is kept is a few seconds; what is shown has as many points as a screen has columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.averaged_spectrum import AveragedSpectrum
from daq.quality import is_clipped
from daq.trigger import SampleStream, Threshold
from rig.interface import Accelerometers

Real = NDArray[np.float64]

HISTORY_S = 2.5
COLUMNS = 1000
SEGMENT_SAMPLES = 4096
"""Of the spectrum: bins of 6 Hz at 25 kHz."""

NOISE_S, STRETCH_S = 2.0, 0.1
"""Noise is the median over stretches, five periods of the mains each: a tap is in fewer than half of them."""

LEVEL_S = 0.5
OVERLOAD_S = 2.0
"""For which an overload is told, so that nobody misses it."""

PRETRIGGER = 0.1
"""Share of a triggered trace before its trigger."""

ARMING_S = 0.05
"""Of quiet stream from which a trigger knows the noise."""


class TapWindow:
    """Waits for the first departure of either accelerometer, or of the hammer, and returns the record around it.

    Parameters
    ----------
    before, after
        Samples before the trigger and from it on; a record never spans samples that were lost, and nothing before
        ``since`` is in it.
    level
        Departure that triggers, m/s2, or N; raised to six standard deviations of the noise of the quietest stretch of
        ``ARMING_S`` since: what still rings when the wait begins does not hide a later tap.
    by_force
        Whether the hammer's force triggers, instead of the accelerations.

    Attributes
    ----------
    found
        Index of the first sample of the record that was returned last.
    """

    def __init__(
        self, before: int, after: int, sample_rate_hz: float, level: float, since: int, by_force: bool = False
    ) -> None:
        self.before, self.after = before, after
        self._rate, self._level, self._by_force = sample_rate_hz, level, by_force
        self._since, self.found = since, since
        self._thresholds: list[Threshold] | None = None
        self._found: int | None = None

    @property
    def waiting(self) -> bool:
        """Whether a tap would be found now."""
        return self._thresholds is not None and self._found is None

    def feed(self, stream: SampleStream) -> Real | None:
        """Look at the block that was read last; return the record, (2, before + after), when it is whole."""
        if stream.unbroken > self._since:
            self._since, self._thresholds, self._found = stream.unbroken, None, None
        arming = round(ARMING_S * self._rate)
        if self._found is None and self._thresholds is None:
            if stream.end - self._since >= max(self.before, arming):
                self._thresholds = self._of_the_latest(stream, arming)
            return None
        if self._found is None and self._thresholds is not None:
            first = stream.last.first_sample
            block = self._watched(stream, first)
            over = [t.first_over(row[None]) for row, t in zip(block, self._thresholds, strict=True)]
            if all(index is None for index in over):
                latest = self._of_the_latest(stream, arming)
                both = zip(self._thresholds, latest, strict=True)
                self._thresholds = [now if now.level < then.level else then for then, now in both]
                return None
            self._found = first + min(index for index in over if index is not None)
        if self._found is None or stream.end < self._found + self.after:
            return None
        self.found = self._found - self.before
        return stream.acceleration(self.found, self._found + self.after)

    def _of_the_latest(self, stream: SampleStream, samples: int) -> list[Threshold]:
        quiet = self._watched(stream, stream.end - samples)
        return [Threshold(row[None], self._rate, self._level) for row in quiet]

    def _watched(self, stream: SampleStream, first: int) -> Real:
        """Return what triggers, (channels, samples), from a sample on."""
        if not self._by_force:
            return stream.acceleration(first, stream.end)
        force = stream.force(first, stream.end)
        return np.zeros((0, stream.end - first)) if force is None else force[None]


@dataclass(frozen=True, slots=True)
class Level:
    """Level of one channel over the last half second.

    Attributes
    ----------
    rms_m_s2, peak_m_s2
        About its mean.
    share
        Largest magnitude over full scale.
    noise_m_s2
        Standard deviation of the quiet of the last seconds; NaN as long as there is none.
    overloaded
        Whether it reached the end of its scale in the last seconds.
    """

    rms_m_s2: float
    peak_m_s2: float
    share: float
    noise_m_s2: float
    overloaded: bool


@dataclass(frozen=True, slots=True)
class Trace:
    """What a screen shows of both channels against time.

    Attributes
    ----------
    first_ms, step_ms
        Time of the first point, from the trigger or the newest sample, and between points.
    acceleration
        (2, points), m/s2: samples, or in turn the smallest and the largest of as many as share a column.
    force
        (points,) of an instrumented hammer, N, likewise; None without one.
    """

    first_ms: float
    step_ms: float
    acceleration: Real
    force: Real | None = None


class LiveSignals:
    """Takes in the stream of a recorder that runs.

    Parameters
    ----------
    recorder
        Started.
    averages, span_ms, triggered, level_m_s2
        See `view`.
    """

    def __init__(
        self, recorder: Accelerometers, averages: int, span_ms: float, triggered: bool, level_m_s2: float
    ) -> None:
        self._recorder = recorder
        self.rate = recorder.sample_rate_hz
        self.stream = SampleStream(recorder)
        self.spectrum = AveragedSpectrum(2, self.rate, SEGMENT_SAMPLES, averages)
        self._overloaded_at = [-np.inf, -np.inf]
        self._lost = 0
        self._sweep: Trace | None = None
        self.view(averages, span_ms, triggered, level_m_s2)

    def view(self, averages: int, span_ms: float, triggered: bool, level_m_s2: float) -> None:
        """Show a trace of ``span_ms``, of the newest samples or from a trigger at ``level_m_s2`` on."""
        self.averages, self.span_ms, self.triggered, self.level_m_s2 = averages, span_ms, triggered, level_m_s2
        if averages != self.spectrum.averages:
            self.spectrum.average_over(averages)
        self._sweep = None
        self._window = self._armed()

    def _armed(self) -> TapWindow | None:
        if not self.triggered:
            return None
        span = self._span()
        before = round(PRETRIGGER * span)
        return TapWindow(before, span - before, self.rate, self.level_m_s2, self.stream.end)

    def _span(self) -> int:
        return max(2, round(self.span_ms * 1e-3 * self.rate))

    def read(self) -> None:
        """Take in the next block."""
        block = self.stream.read()
        if self.stream.lost > self._lost:
            self._lost = self.stream.lost
            self.spectrum.break_off()
        self.spectrum.add(block.acceleration)
        clipped = is_clipped(block.acceleration, self._recorder.full_scale_m_s2, self._recorder.bits)
        for i in (0, 1):
            if clipped[i]:
                self._overloaded_at[i] = self.stream.end
        if self._window is not None and (record := self._window.feed(self.stream)) is not None:
            force = self.stream.force(self._window.found, self._window.found + record.shape[1])
            self._sweep = _on_screen(record, force, -self._window.before, self.rate)
            self._window = self._armed()
        self.stream.forget(self.stream.end - round(HISTORY_S * self.rate))

    @property
    def lost(self) -> int:
        """Samples that the recorder lost so far."""
        return self._lost

    def trace(self) -> Trace | None:
        """Return what is to be shown; None as long as there is nothing."""
        if self.triggered:
            return self._sweep
        span = min(self._span(), self.stream.end - self.stream.begin)
        if span < 2:
            return None
        first, end = self.stream.end - span, self.stream.end
        return _on_screen(self.stream.acceleration(first, end), self.stream.force(first, end), -span, self.rate)

    def levels(self) -> tuple[Level, Level]:
        """Return the level of each channel."""
        stream = self.stream
        kept = stream.acceleration(stream.begin, stream.end)
        latest = kept[:, -round(LEVEL_S * self.rate) :]
        departure = np.abs(latest - latest.mean(axis=1, keepdims=True))
        stretch = round(STRETCH_S * self.rate)
        usable = min(kept.shape[1], round(NOISE_S * self.rate)) // stretch * stretch
        noise = np.full(2, np.nan)
        if usable:
            noise = np.median(kept[:, -usable:].reshape(2, -1, stretch).std(axis=2), axis=1)
        a, b = (
            Level(
                float(latest[i].std()),
                float(departure[i].max()),
                float(np.abs(latest[i]).max() / self._recorder.full_scale_m_s2),
                float(noise[i]),
                bool(stream.end - self._overloaded_at[i] < OVERLOAD_S * self.rate),
            )
            for i in (0, 1)
        )
        return a, b


def _on_screen(acceleration: Real, force: Real | None, first: int, sample_rate_hz: float) -> Trace:
    """Return samples as a trace of two points a column at most; ``first`` is the index of the first sample."""
    record = acceleration if force is None else np.vstack([acceleration, force])
    n = record.shape[1]
    step_ms = 1e3 / sample_rate_hz
    first_ms = first * step_ms
    if n > 2 * COLUMNS:
        each = n // COLUMNS
        columns = record[:, : each * COLUMNS].reshape(len(record), COLUMNS, each)
        ends = np.stack([columns.min(axis=2), columns.max(axis=2)], axis=2)
        falling = columns.argmin(axis=2) > columns.argmax(axis=2)
        ends[falling] = ends[falling][:, ::-1]
        record, step_ms = ends.reshape(len(record), -1), each * step_ms / 2
    return Trace(first_ms, step_ms, record[:2], None if force is None else record[2])
