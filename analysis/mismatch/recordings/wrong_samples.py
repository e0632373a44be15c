"""Samples that are wrong by themselves: a converter's glitch, a bit that was lost, the far tails of noise.

No motion of a rig is off in one sample and right in the next ones. Such samples are put where the simulation and what
noise leads to expect of their neighbours have them, and they are told. Additive outliers of an autoregression: Fox, J.
Roy. Stat. Soc. B 34 (1972) 350; found one after another as by Chang, Tiao and Chen, Technometrics 30 (1988) 193.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.stats import norm

from analysis.mismatch.answer import SetAside
from analysis.mismatch.recordings.model import residual
from analysis.mismatch.recordings.noise import Whitening, floor_of
from analysis.mismatch.recordings.outliers import CLOSE, MOST, NORMAL_MEDIAN, Outlier, by_themselves
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, UNUSED, Recorded, WrongSample
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import ChannelDistortion

if TYPE_CHECKING:
    from analysis.mismatch.recordings.fit import SimulatedFit

FEW: Final = 2  # wrong samples of a recording that may lie anywhere, once all mechanisms have been told from them
NAMED: Final = 5  # of them, whose times are told
SHORT_BLOW: Final = " A blow shorter than the time between samples would show so in an acceleration, and then ring."
PASSES: Final = 2  # in the first one the noise is known from a residual that holds the wrong samples


def without_wrong_samples(fitted: SimulatedFit, told: bool = False) -> tuple[Recorded, ...]:
    """Return the recordings of a fit that leaves noise but for single samples, with these put right; else as they are.

    Where a fit leaves more than noise, what is odd in a sample may be the rig. Where motion is large one or two may be
    the rig, too, until all mechanisms have been ``told`` from them.
    """
    return tuple(_put_right(fitted, number, told) for number in range(len(fitted.own)))


def _put_right(fitted: SimulatedFit, number: int, told: bool) -> Recorded:
    recorded, level = fitted.problem.recordings[number], fitted.problem.policy.level
    if recorded.band is not None:
        return recorded  # a filter has spread what was wrong
    off, at = residual(fitted.simulation, fitted.x, fitted.own[number], number, samples=recorded.samples)
    used, passed_over = np.isin(recorded.part[at], (FIT, CHOOSE)), np.zeros(off.shape[1], bool)
    if any(isinstance(term.mechanism, ChannelDistortion) for term in fitted.terms):
        passed_over = recorded.part[at] == UNUSED  # at the ends it may be interpolated from one side
    rows, found = off.copy(), []
    if not _as_good_as_noise(rows, used, fitted):
        return recorded
    for channel, row in enumerate(rows):
        found += _taken_out(row, used, channel, level / off.size, recorded, passed_over)
    shown = off + recorded.outputs[:, at] / recorded.unit[:, None]
    anywhere = told and len(found) <= FEW
    if not found or not by_themselves(found, shown, level, anywhere) or not _as_good_as_noise(rows, used, fitted):
        return recorded
    outputs = recorded.outputs.copy()
    outputs[:, at] += (off - rows) * recorded.unit[:, None]
    begun = recorded.start_s + (at.start or 0) / recorded.rate_hz
    wrong = [WrongSample(w.channel, begun + w.sample / recorded.rate_hz, w.over_noise) for w in found]
    return replace(recorded, outputs=outputs, wrong=(*recorded.wrong, *wrong))


def _taken_out(
    row: Real,
    used: NDArray[np.bool_],
    channel: int,
    chance: float,
    recorded: Recorded,
    passed_over: NDArray[np.bool_] | None = None,
) -> list[Outlier]:
    """Take samples that are off by more than noise is by ``chance`` out of a residual (n,), the furthest first."""
    found: dict[int, float] = {}
    limit, error = float(norm.isf(chance / 2)), 0.0
    for _ in range(PASSES):
        outliers = _Outliers.of(row, Whitening.of(row[None], used, floor_of(recorded)))
        if passed_over is not None:
            outliers.power[passed_over] = np.inf
        if recorded.free:
            outliers.power[: 2 * outliers.pulses.shape[1]] = np.inf  # where a decay begins a rig does much
        error = float(np.median(np.abs(outliers.score()[used]))) / NORMAL_MEDIAN
        for i in found:
            found[i] += outliers.take(i)
        while len(found) <= MOST * row.size:
            score = np.abs(outliers.score())
            i = int(np.argmax(score))
            if not score[i] > limit * error > 0:
                break
            found[i] = found.get(i, 0.0) + outliers.take(i)
    return [Outlier(channel, i, size, abs(size) * math.sqrt(outliers.power[i]) / error) for i, size in found.items()]


@dataclass(frozen=True, slots=True)
class _Outliers:
    """By how much each sample of a row (n,) is off what an autoregression leads to expect from both sides.

    Attributes
    ----------
    white
        (n + order,) what the past does not foretell, and zeros.
    pulses
        (n, order + 1) what a unit of error in a sample makes of it and of those that follow in that.
    seen, power
        (n,) their products with it, and with themselves: the ratio is the likeliest error.
    """

    row: Real
    white: Real
    pulses: Real
    seen: Real
    power: Real

    @classmethod
    def of(cls, row: Real, whitening: Whitening) -> _Outliers:
        taps = whitening.taps[0, 0] / whitening.noise[0]
        order = taps.size - 1
        pulses = np.tile(taps, (row.size, 1))
        begun = whitening(np.eye(order, 3 * order)[:, None])[:, 0]
        for i in range(order):
            pulses[i] = begun[i, i : i + order + 1]
            pulses[row.size - 1 - i, i + 1 :] = 0.0
        white = np.append(whitening(row[None])[0], np.zeros(order))
        seen = np.einsum("nk,nk->n", pulses, sliding_window_view(white, order + 1))
        return cls(row, white, pulses, seen, np.einsum("nk,nk->n", pulses, pulses))

    def score(self) -> Real:
        """Return (n,) the likeliest errors in standard errors of noise whitened to an rms of one."""
        return np.asarray(self.seen / np.sqrt(self.power), np.float64)

    def take(self, i: int) -> float:
        """Take the error of a sample out of the row, and return it."""
        size, order = float(self.seen[i] / self.power[i]), self.pulses.shape[1] - 1
        self.row[i] -= size
        self.white[i : i + order + 1] -= size * self.pulses[i]
        near = slice(max(i - order, 0), min(i + order + 1, self.row.size))
        after = sliding_window_view(self.white[near.start : near.stop + order], order + 1)
        self.seen[near] = np.einsum("nk,nk->n", self.pulses[near], after)
        return size


def _as_good_as_noise(rows: Real, used: NDArray[np.bool_], fitted: SimulatedFit) -> bool:
    """Whether a residual (c, n) is hardly more than what cannot be predicted of it."""
    floor = floor_of(fitted.problem.recordings[0])
    noise = [float(Whitening.of(row[None], used, floor).noise[0]) for row in rows]
    over = np.mean(rows[:, used] ** 2, axis=1) / np.maximum(np.square(noise), 1e-300)
    return bool(np.mean(over) < fitted.problem.policy.unlike_noise)


def set_aside(fitted: SimulatedFit) -> tuple[SetAside, ...]:
    """Return what is said of the samples that were put right, by recording and channel, and of those left out.

    What an impact that is named shows as it strikes is no motion of the rig either; that is not told.
    """
    found = []
    for recorded, own in zip(fitted.problem.recordings, fitted.own, strict=True):
        struck = [recorded.start_s + float(t) for t in own.impact[:1]]
        beside = (CLOSE + 1) / recorded.rate_hz
        if recorded.struck:
            until = f"{recorded.struck} samples after its largest deflection the rig was still struck"
            said = f"{Path(recorded.source).name}: {until}; the decay is taken from {recorded.start_s:.6g} s on."
            found.append(SetAside(recorded.source, "", said))
        for number, seen in enumerate(fitted.problem.rig.seen):
            blow = SHORT_BLOW if seen.sensor.quantity == "acceleration" else ""
            wrong = [w for w in recorded.wrong if w.channel == number and not _beside(w.time_s, struck, beside)]
            if wrong:
                name = f"{recorded.source}, channel {seen.channel}"
                found.append(SetAside(name, "", f"{Path(name).name}: {_told(wrong)}{blow}"))
    return tuple(found)


def _beside(time_s: float, others: Sequence[float], within: float) -> bool:
    return any(abs(time_s - other) <= within for other in others)


def _told(wrong: Sequence[WrongSample]) -> str:
    """Say how many samples of a channel were wrong, when and by how much, and what may have made them so."""
    worst = sorted(wrong, key=lambda w: -w.over_noise)[:NAMED]
    times = ", ".join(f"{w.time_s:.6g} s ({w.over_noise:.3g} times the noise)" for w in worst)
    if len(wrong) == 1:
        return f"one sample is off and the next one right again, at {times}. No motion does that: a wrong sample."
    which = "the worst at" if len(wrong) > NAMED else "at"
    tails = "wrong samples, or noise with far tails" if len(wrong) > NAMED else "wrong samples"
    return f"{len(wrong)} samples are off and the next ones right again, {which} {times}. No motion does that: {tails}."
