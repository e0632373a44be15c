"""From the stream of samples to a record of one tap: pretrigger, tap, threshold, record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from daq.errors import RecordingError
from daq.quality import WIRING_CHECK
from daq.settings import Trigger
from rig.errors import RigError
from rig.interface import Accelerometers, Clock, Impactor, nothing
from rig.readings import Block

BASELINE_S = 0.1
"""Time constant of the running mean that a sample is held against, s."""

NOISE_MULTIPLE = 6.0
"""A threshold under this many standard deviations of the noise is raised to it: one sample in 10^9 passes."""

GAUSSIAN_MAD = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""


class NoTap(RigError):
    """There is no record of a tap, but nothing speaks against another one."""


class SamplesLost(NoTap):
    """The recorder lost samples where the record would have been."""


@dataclass(frozen=True, slots=True)
class Record:
    """One tap as it left the recorder.

    Attributes
    ----------
    acceleration
        (2, n) accelerations A and B, m/s2.
    strain_mv
        (n,) bridge voltage, or None where the recorder does not sample it.
    pretrigger
        Number of samples before the one that passed the threshold.
    sample_rate_hz
        Sampling rate, Hz.
    time
        ISO 8601 UTC of the trigger.
    force
        (n,) force of an instrumented hammer, N, or None without one.
    """

    acceleration: NDArray[np.float64]
    strain_mv: NDArray[np.float64] | None
    pretrigger: int
    sample_rate_hz: float
    time: str
    force: NDArray[np.float64] | None = None


class SampleStream:
    """The blocks as one run of samples without gaps, of which the oldest can be forgotten.

    Where the recorder lost samples the run begins anew: nothing is ever joined across a gap.

    Attributes
    ----------
    begin, end
        Indices of the first sample kept and of the one to come next.
    unbroken
        Index since which no sample was lost.
    lost
        Samples lost so far.
    last
        The block that was read last.
    """

    last: Block

    def __init__(self, accelerometers: Accelerometers) -> None:
        self._source = accelerometers
        self._blocks: list[Block] = []
        self.begin = 0
        self.end = 0
        self.unbroken = 0
        self.lost = 0

    def read(self) -> Block:
        """Take in the next block; `RigError` if it cannot be one."""
        block = self._source.read_block()
        samples = block.acceleration.shape[-1]
        if block.acceleration.ndim != 2 or len(block.acceleration) != 2 or not samples:
            raise RigError(f"The recorder delivered a block of shape {block.acceleration.shape}, expected (2, n).")
        if block.first_sample < self.end:
            raise RigError(
                f"The recorder sent sample {block.first_sample} again where {self.end} was due; check its driver."
            )
        if not np.isfinite(block.acceleration).all():
            raise RigError("The recorder delivered a value that is not a number; check its driver.")
        if block.strain_mv is not None and block.strain_mv.shape != (samples,):
            raise RigError(f"The recorder delivered {block.strain_mv.shape} strain values for {samples} samples.")
        if block.force is not None and block.force.shape != (samples,):
            raise RigError(f"The recorder delivered {block.force.shape} values of the force for {samples} samples.")
        if block.first_sample > self.end:
            self.lost += block.first_sample - self.end
            self._blocks.clear()
            self.begin = self.end = self.unbroken = block.first_sample
        self._blocks.append(block)
        self.last = block
        self.end += samples
        return block

    def forget(self, before: int) -> None:
        """Drop whole blocks that end at or before sample ``before``."""
        while self._blocks and self.begin + self._blocks[0].acceleration.shape[1] <= before:
            self.begin += self._blocks.pop(0).acceleration.shape[1]

    def acceleration(self, first: int, last: int) -> NDArray[np.float64]:
        """Return samples ``first`` to ``last`` (not included), (2, last - first)."""
        joined = np.concatenate([block.acceleration for block in self._blocks], axis=1)
        return np.array(joined[:, first - self.begin : last - self.begin], dtype=np.float64)

    def strain(self, first: int, last: int) -> NDArray[np.float64] | None:
        """Return the strain-gauge voltage of the same samples, None where any block lacks it."""
        return self._joined([block.strain_mv for block in self._blocks], first, last)

    def force(self, first: int, last: int) -> NDArray[np.float64] | None:
        """Return the hammer's force in the same samples, None where any block lacks it."""
        return self._joined([block.force for block in self._blocks], first, last)

    def _joined(self, parts: list[NDArray[np.float64] | None], first: int, last: int) -> NDArray[np.float64] | None:
        if any(part is None for part in parts):
            return None
        joined = np.concatenate([part for part in parts if part is not None])
        return np.array(joined[first - self.begin : last - self.begin], dtype=np.float64)


class Threshold:
    """Finds the first sample of the mean of A and B that departs from its running mean, either way."""

    def __init__(self, quiet: NDArray[np.float64], sample_rate_hz: float, threshold_m_s2: float) -> None:
        mean = quiet.mean(axis=0)
        baseline = float(np.median(mean))
        sigma = GAUSSIAN_MAD * float(np.median(np.abs(mean - baseline)))
        self.level = max(threshold_m_s2, NOISE_MULTIPLE * sigma)
        self._alpha = 1.0 / max(1.0, BASELINE_S * sample_rate_hz)
        self._baseline = baseline

    def first_over(self, acceleration: NDArray[np.float64]) -> int | None:
        """Return the index in this block (2, n), which follows the one before, of the first sample over, or None."""
        mean = acceleration.mean(axis=0)
        decay = 1.0 - self._alpha
        running, _ = signal.lfilter([self._alpha], [1.0, -decay], mean, zi=[decay * self._baseline])
        before = np.concatenate([[self._baseline], running[:-1]])
        over = np.abs(mean - before) > self.level
        if over.any():
            return int(np.argmax(over))
        self._baseline = float(running[-1])
        return None


def record_impact(
    accelerometers: Accelerometers,
    impactor: Impactor,
    clock: Clock,
    trigger: Trigger,
    load_mn: float,
    hint: str = "",
    idle: Callable[[], None] = nothing,
    heed: Callable[[], None] = nothing,
) -> Record:
    """Have one tap made and record it. The stream is stopped on return, also by an error.

    Only samples after the pretrigger stretch are looked at, so every record has its whole pretrigger. The
    threshold is raised to 6 standard deviations of the noise before the tap where it lies below that. A record
    never spans samples that were lost; samples lost before the tap cost nothing.

    Parameters
    ----------
    load_mn, hint
        Passed on to ``impactor.tap``.
    idle
        Called after each block until the tap is felt; what it raises ends the waiting.
    heed
        The same from then on, until the record is whole.

    Raises
    ------
    NoTap
        Nothing passed the threshold within ``trigger.timeout_s`` of the tap.
    SamplesLost
        Samples were lost from the record, or just before the tap.
    RigError
        A part failed.
    RecordingError
        The settings leave no room for the tap in the record.
    """
    if trigger.pretrigger_samples >= trigger.record_samples:
        raise RecordingError(
            f"daq.trigger: pretrigger_samples ({trigger.pretrigger_samples}) must be smaller "
            f"than record_samples ({trigger.record_samples})"
        )
    stream = SampleStream(accelerometers)
    try:
        accelerometers.start()
        rate = accelerometers.sample_rate_hz
        last_sample = trigger.pretrigger_samples + trigger.timeout_s * rate
        while stream.end - stream.begin < trigger.pretrigger_samples:
            stream.read()
            idle()
            if stream.end > last_sample:
                raise _lost(stream)
        threshold = Threshold(stream.acceleration(stream.begin, stream.end), rate, trigger.threshold_m_s2)
        called = clock.now()
        impactor.tap(load_mn, hint)
        found = _await_tap(stream, threshold, clock, trigger, clock.now() - called, rate, idle)
        time = clock.utc()
        first = found - trigger.pretrigger_samples
        last = first + trigger.record_samples
        while stream.end < last:
            stream.read()
            if stream.unbroken > first:
                raise _lost(stream)
            heed()
        return Record(
            stream.acceleration(first, last),
            stream.strain(first, last),
            trigger.pretrigger_samples,
            rate,
            time,
            stream.force(first, last),
        )
    finally:
        accelerometers.stop()


def _await_tap(
    stream: SampleStream,
    threshold: Threshold,
    clock: Clock,
    trigger: Trigger,
    strike_s: float,
    rate: float,
    idle: Callable[[], None],
) -> int:
    """Return the index of the trigger sample. Time is counted by the clock and by the samples, in case one stands."""
    deadline = clock.now() + trigger.timeout_s
    last_sample = stream.end + (trigger.timeout_s + strike_s) * rate
    while True:
        block = stream.read()
        over = threshold.first_over(block.acceleration)
        if over is not None:
            found = block.first_sample + over
            if found - stream.unbroken < trigger.pretrigger_samples:
                raise _lost(stream)  # only after a gap: before the tap there was a whole pretrigger stretch
            return found
        stream.forget(stream.end - trigger.pretrigger_samples)
        idle()
        if clock.now() > deadline or stream.end > last_sample:
            if stream.lost:
                raise _lost(stream)
            raise NoTap(
                f"No tap within {trigger.timeout_s:g} s: nothing passed {threshold.level:.3g} m/s2; tap harder, "
                "or check that the accelerometers are plugged in, and neither upside down (with B against A their "
                f"mean, which is looked at, vanishes): {WIRING_CHECK}."
            )


def _lost(stream: SampleStream) -> SamplesLost:
    return SamplesLost(
        f"The recorder lost {stream.lost} samples while the tap was waited for; close other programs, and tap again."
    )


QUIET_S = 0.001
"""Length of the stretches among which a finished record's quietest is looked for, s."""

PEAK_FRACTION = 0.02
"""Fraction of a finished record's peak that its onset has to pass."""


@np.errstate(over="ignore", invalid="ignore")  # a file may hold numbers whose squares are none
def find_trigger(acceleration: NDArray[np.float64], sample_rate_hz: float, threshold: float | None = None) -> int:
    """Return the index of the sample where the tap begins in a finished record.

    The baseline of each channel is the median of its first millisecond where that is quiet (no more than three times
    as loud as the quietest one), of the whole channel otherwise.

    Parameters
    ----------
    acceleration
        (c, n) or (n,) samples; any channel can trigger.
    threshold
        Departure from the baseline to pass, in the unit of the samples; by default 2 % of the largest departure,
        or 6 standard deviations of the noise where that is more: that of the first millisecond, or of the quietest.

    Raises
    ------
    RecordingError
        No sample passes: there is no tap in the record.
    """
    data = np.atleast_2d(np.asarray(acceleration, dtype=np.float64))
    samples = data.shape[1]
    length = min(samples, max(8, round(QUIET_S * sample_rate_hz)))
    stretches = data[:, : samples // length * length].reshape(len(data), -1, length)
    loudness = stretches.std(axis=2)
    quietest = loudness.min(axis=1)
    begins_quiet = loudness[:, 0] <= 3 * quietest
    noise = np.where(begins_quiet, loudness[:, 0], quietest)
    baseline = np.where(begins_quiet, np.median(stretches[:, 0], axis=1), np.median(data, axis=1))
    departure = np.abs(data - baseline[:, None])
    level = (
        np.maximum(PEAK_FRACTION * departure.max(axis=1), NOISE_MULTIPLE * noise)
        if threshold is None
        else np.full(len(data), threshold)
    )
    over = (departure > level[:, None]).any(axis=0)
    if not over.any():
        raise RecordingError("no sample passes the trigger level: there is no tap in the record")
    return int(np.argmax(over))
