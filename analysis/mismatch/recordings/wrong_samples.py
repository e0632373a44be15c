"""Samples that are wrong by themselves: a converter's glitch, a bit that was lost, the far tails of noise.

No motion of a rig is off in one sample and right in the next ones. Such samples are put where the simulation and what
noise leads to expect of their neighbours have them, and they are told. Additive outliers of an autoregression: Fox, J.
Roy. Stat. Soc. B 34 (1972) 350; found one after another as by Chang, Tiao and Chen, Technometrics 30 (1988) 193.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.stats import norm

from analysis.mismatch.answer import SetAside
from analysis.mismatch.recordings.model import residual
from analysis.mismatch.recordings.noise import Whitening, floor_of
from analysis.mismatch.recordings.outliers import MOST, NORMAL_MEDIAN, Outlier, by_themselves
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, Recorded, WrongSample
from sim_backend.arrays import Real

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

PASSES: Final = 2  # in the first one the noise is known from a residual that holds the wrong samples


def without_wrong_samples(fitted: SimulatedFit) -> tuple[Recorded, ...]:
    """Return the recordings of a fit that leaves noise but for single samples, with these put right; else as they are.

    Where a fit leaves more than noise, what is odd in a sample may be the rig.
    """
    return tuple(_put_right(fitted, number) for number in range(len(fitted.own)))


def _put_right(fitted: SimulatedFit, number: int) -> Recorded:
    recorded, level = fitted.problem.recordings[number], fitted.problem.policy.level
    if recorded.band is not None:
        return recorded  # a filter has spread what was wrong
    off, at = residual(fitted.simulation, fitted.x, fitted.own[number], number, samples=recorded.samples)
    used = np.isin(recorded.part[at], (FIT, CHOOSE))
    rows, found = off.copy(), []
    for channel, row in enumerate(rows):
        found += _taken_out(row, used, channel, level / off.size, floor_of(recorded))
    shown = off + recorded.outputs[:, at] / recorded.unit[:, None]
    if not found or not by_themselves(found, shown, level) or not _as_good_as_noise(rows, used, fitted):
        return recorded
    outputs = recorded.outputs.copy()
    outputs[:, at] += (off - rows) * recorded.unit[:, None]
    begun = recorded.start_s + (at.start or 0) / recorded.rate_hz
    told = [WrongSample(w.channel, begun + w.sample / recorded.rate_hz, w.over_noise) for w in found]
    return replace(recorded, outputs=outputs, wrong=(*recorded.wrong, *told))


def _taken_out(row: Real, used: NDArray[np.bool_], channel: int, chance: float, floor: float) -> list[Outlier]:
    """Take samples that are off by more than noise is by ``chance`` out of a residual (n,), the furthest first."""
    found: dict[int, float] = {}
    limit, error = float(norm.isf(chance / 2)), 0.0
    for _ in range(PASSES):
        whitening = Whitening.of(row[None], used, floor)
        outliers = _Outliers.of(row, whitening.taps[0, 0] / whitening.noise[0])
        error = float(np.median(np.abs(outliers.off[used]))) / NORMAL_MEDIAN
        for i in found:
            found[i] += outliers.take(i)
        while len(found) <= MOST * row.size:
            i = outliers.furthest()
            if not abs(outliers.off[i]) > limit * error > 0:
                break
            found[i] = found.get(i, 0.0) + outliers.take(i)
    return [Outlier(channel, i, size, abs(size) / max(error, 1e-300)) for i, size in found.items()]


@dataclass(frozen=True, slots=True)
class _Outliers:
    """By how much each sample of a row (n,) is off what an autoregression (``taps``) leads to expect of both sides.

    ``white`` (n,) is what the past alone does not foretell, ``off`` (n,) the likeliest error of each sample by itself.
    """

    row: Real
    taps: Real
    white: Real
    off: Real

    @classmethod
    def of(cls, row: Real, taps: Real) -> _Outliers:
        white = signal.lfilter(taps, [1.0], row)
        return cls(row, taps, white, np.convolve(white, taps[::-1])[taps.size - 1 :] / float(taps @ taps))

    def furthest(self) -> int:
        """Return the sample that is furthest off, of those with a past and a future: decays begin at once."""
        order = self.taps.size - 1
        return order + int(np.argmax(np.abs(self.off[order : self.row.size - order])))

    def take(self, i: int) -> float:
        """Take the error of a sample out of the row, and return it."""
        size, order = float(self.off[i]), self.taps.size - 1
        self.row[i] -= size
        after = self.white[i : i + order + 1]
        after -= size * self.taps[: after.size]
        first, last = max(i - order, 0), min(i + order + 1, self.row.size)
        seen = np.append(self.white[first : last + order], np.zeros(order))[: last - first + order]
        self.off[first:last] = np.correlate(seen, self.taps, "valid") / float(self.taps @ self.taps)
        return size


def _as_good_as_noise(rows: Real, used: NDArray[np.bool_], fitted: SimulatedFit) -> bool:
    """Whether a residual (c, n) is hardly more than what cannot be predicted of it."""
    floor = floor_of(fitted.problem.recordings[0])
    noise = [float(Whitening.of(row[None], used, floor).noise[0]) for row in rows]
    over = np.mean(rows[:, used] ** 2, axis=1) / np.maximum(np.square(noise), 1e-300)
    return bool(np.mean(over) < fitted.problem.policy.unlike_noise)


def set_aside(recordings: Sequence[Recorded], channels: Sequence[str]) -> tuple[SetAside, ...]:
    """Return what is said of the samples of recordings that were put right, by recording and channel."""
    found = []
    for recorded in recordings:
        for number, channel in enumerate(channels):
            wrong = [w for w in recorded.wrong if w.channel == number]
            if wrong:
                worst = max(wrong, key=lambda w: w.over_noise)
                time = f"{worst.time_s:.6g} s"
                which = f"One sample, at {time}," if len(wrong) == 1 else f"{len(wrong)} samples, the worst at {time},"
                said = (
                    f"{which} {recorded.source}, channel {channel}: off by {worst.over_noise:.3g} times the noise and "
                    "right again in the next sample. No motion does that; the rest of the recording tells what would "
                    "stand there."
                )
                found.append(SetAside(f"{recorded.source}, channel {channel}", "", said))
    return tuple(found)
