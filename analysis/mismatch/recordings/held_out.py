"""Whether what was held out is missed by more than noise, block by block and channel by channel.

Errors are whitened as noise asks, so that they are compared with what cannot be predicted of them elsewhere: an event
within a held-out block, whose ringing the whitening takes for noise in the blocks that follow, stands out in its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from analysis.mismatch.answer import ChannelErrors
from analysis.mismatch.chi_squared import p_of
from analysis.mismatch.linearised import covariance
from analysis.mismatch.recordings.blocks import noise_rms
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings, fit
from analysis.mismatch.recordings.model import residual, residuals, slopes, steps_of, ways
from analysis.mismatch.recordings.motion import Place
from analysis.mismatch.recordings.nearby import beside_jumps, nearby
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, HELD
from analysis.mismatch.recordings.second_impact import on_the_right_side
from analysis.mismatch.recordings.signatures import noise_drawn
from analysis.mismatch.recordings.start_check import worse_than_zero
from sim_backend.arrays import Real

FEWEST: Final = 16  # samples of a block that are tested
BY_CHANCE: Final = 2.0  # standard errors that the kurtosis of normal noise may be above 3


@dataclass(frozen=True, slots=True)
class HeldOutBlock:
    """Errors of a channel in a held-out block.

    Attributes
    ----------
    recording, channel
        Their numbers.
    time_s
        Of its first and last sample in the file.
    ratio
        Rms of the whitened errors, over what noise and the uncertainty of the fit lead to expect.
    p_value
        Of noise making it as large; of this block and channel alone.
    """

    recording: int
    channel: int
    time_s: tuple[float, float]
    ratio: float
    p_value: float


@dataclass(frozen=True, slots=True)
class HeldOutErrors:
    """All blocks that were held out after the beginning of what is fitted."""

    blocks: tuple[HeldOutBlock, ...]

    @property
    def p_value(self) -> float:
        """That noise makes any block and channel stand out as much as the one that does most."""
        return p_of(min(b.p_value for b in self.blocks), len(self.blocks)) if self.blocks else 1.0

    def worst(self) -> HeldOutBlock:
        """Return the block and channel that noise is the least likely to have made."""
        return min(self.blocks, key=lambda b: (b.p_value, -b.ratio))

    def ratio(self, channel: int) -> float:
        """Return the rms of a channel's whitened errors over what noise leads to expect; 1 where nothing is tested."""
        squares = [b.ratio**2 for b in self.blocks if b.channel == channel]
        return float(np.sqrt(np.mean(squares))) if squares else 1.0


@dataclass(slots=True)
class FinalFits:
    """Models fitted once more to all that is not held out, and their errors on what is; each is computed once."""

    found: dict[int, tuple[SimulatedFit, SimulatedFit]] = field(default_factory=dict)
    tested: dict[int, HeldOutErrors] = field(default_factory=dict)
    compared: dict[int, str] = field(default_factory=dict)

    def of(self, fitted: SimulatedFit) -> SimulatedFit:
        """Return the final fit of a model that was fitted to some blocks."""
        if id(fitted) not in self.found:
            self.found[id(fitted)] = fitted, on_the_right_side(_final(fitted), _final)
        return self.found[id(fitted)][1]

    def worse_than_zero(self, linear: SimulatedFit, best: SimulatedFit) -> str:
        """Say that the linear rig predicts worse than zero, and what to leave free; see `start_check`."""
        if id(best) not in self.compared:
            self.compared[id(best)] = worse_than_zero(linear, best)
        return self.compared[id(best)]

    def errors(self, final: SimulatedFit) -> HeldOutErrors:
        """Return the errors of a final fit."""
        if id(final) not in self.tested:
            self.tested[id(final)] = held_out_errors(final)
        return self.tested[id(final)]


def _final(begun: SimulatedFit) -> SimulatedFit:
    return fit(begun.problem, begun.terms, begun, parts=(FIT, CHOOSE), fine=True)


@dataclass(frozen=True, slots=True)
class WhitenedErrors:
    """Errors of a recording (c, n), and what a unit of each number of the fit changes in them, (k, c, n).

    ``weights`` counts (c,) the weights of the whitening, which are fitted to the errors, too; ``drawn`` (draws, c, n)
    are draws of the noise, where that of inputs counts.
    """

    error: Real
    slopes: Real
    where: NDArray[np.intp]
    part: NDArray[np.int64]
    block: NDArray[np.int64]
    weights: Real
    drawn: Real

    def flat(self, parts: Sequence[int]) -> Real:
        """Return (k, m) the slopes at the samples of these parts."""
        return self.slopes[:, :, np.isin(self.part, parts)].reshape(len(self.where), -1)


def held_out_errors(fitted: SimulatedFit) -> HeldOutErrors:
    """Compare the errors of a fit on held-out blocks with those on what was fitted.

    Before what is fitted begins the rig's state is not known: errors there are no part of it.
    """
    whitened = [whitened_errors(fitted, number) for number in range(len(fitted.own))]
    normal, pulled = normal_equations(fitted, whitened, fitted.parts)
    spread = covariance(normal)
    moved = spread @ pulled  # what draws of the noise make of the fit's numbers
    found: list[HeldOutBlock] = []
    for number, w in enumerate(whitened):
        left = w.drawn - np.tensordot(moved[w.where], w.slopes, axes=(0, 0))
        found += _blocks(fitted, number, w, spread[np.ix_(w.where, w.where)], left)
    return HeldOutErrors(tuple(found))


def whitened_errors(fitted: SimulatedFit, number: int, as_left_by: SimulatedFit | None = None) -> WhitenedErrors:
    """Return the errors of a recording, whitened as what the fit leaves asks, or as another one does."""
    simulation, own, recorded = fitted.simulation, fitted.own[number], fitted.problem.recordings[number]
    off, at = residual(simulation, fitted.x, own, number, samples=recorded.samples)
    part = recorded.part[at]
    noise, near = (as_left_by or fitted).noise(number), nearby(simulation, fitted.x, own, number, recorded.samples)

    def changed(places: Sequence[Place]) -> Real:
        made, _ = residuals(near, places, number, samples=recorded.samples)
        return np.array([noise.white(y - off) for y in made])

    scale, steps = simulation.own_scale(number, own), steps_of(simulation, fitted.x, own, number)
    common, begun = slopes(changed, fitted.x, own, steps, ways(simulation), scale)
    first = fitted.x.size + sum(o.size for o in fitted.own[:number])
    where = np.concatenate([np.arange(fitted.x.size), first + np.arange(own.size)])
    columns = np.concatenate([common, begun], axis=1).T.reshape(-1, *off.shape)
    weights = np.count_nonzero(noise.own.taps, axis=(1, 2)) - 1
    counted = bool(fitted.problem.draws(fitted))
    drawn = noise_drawn(fitted, number, off.shape[1]) if counted else np.zeros((0, *off.shape))
    beside = beside_jumps(near)
    told = np.where(beside, 0.0, off) if beside.size else off
    return WhitenedErrors(noise.white(told), columns, where, part, recorded.block[at], weights, drawn)


def normal_equations(
    fitted: SimulatedFit, whitened: Sequence[WhitenedErrors], parts: Sequence[int]
) -> tuple[Real, Real]:
    """Return (k, k) inner products of the slopes at the samples of these parts, and (k, draws) those with draws.

    The numbers are all the fit's, in the order of ``where``; what is declared of them counts.
    """
    size = fitted.x.size + sum(o.size for o in fitted.own)
    normal, pulled = np.zeros((size, size)), np.zeros((size, len(whitened[0].drawn)))
    for w in whitened:
        columns, drawn = w.flat(parts), w.drawn[:, :, np.isin(w.part, parts)]
        normal[np.ix_(w.where, w.where)] += columns @ columns.T
        pulled[w.where] += columns @ drawn.reshape(len(drawn), columns.shape[1]).T
    for k, p in enumerate(fitted.simulation.parameters):
        normal[k, k] += 0.0 if p.prior is None else 1 / p.prior[1] ** 2
    return normal, pulled


def _blocks(
    fitted: SimulatedFit, number: int, whitened: WhitenedErrors, spread: Real, drawn: Real
) -> list[HeldOutBlock]:
    """Return the held-out blocks of a recording, by channel; ``drawn`` is what a fit leaves of draws of the noise."""
    recorded, found = fitted.problem.recordings[number], []
    first = recorded.start_s + recorded.fitted.start / recorded.rate_hz
    used, held = np.isin(whitened.part, fitted.parts), whitened.part == HELD
    for channel, error in enumerate(whitened.error):
        columns = whitened.slopes[:, channel]
        leverage = np.einsum("kn,kl,ln->n", columns, spread, columns, optimize=True)
        leverage += whitened.weights[channel] / np.count_nonzero(used)
        freedom = max(float(np.sum(1 - leverage[used])), 1.0)
        noise, told = float(np.sum(error[used] ** 2)) / freedom, _as_many_normal(error[used])
        for block in np.unique(whitened.block[held]):
            at = np.flatnonzero(held & (whitened.block == block))
            if at.size < FEWEST or not noise > 0:
                continue
            if len(drawn):
                share = whitened.weights[channel] / np.count_nonzero(used)
                ratio, p_value = _among(drawn[:, channel], error, used, at, share)
            else:
                ratio = float(np.sum(error[at] ** 2) / np.sum(1 + leverage[at])) / noise
                p_value = float(f_distribution.sf(ratio, at.size * told, freedom * told))
            time_s = (float(first + at[0] / recorded.rate_hz), float(first + at[-1] / recorded.rate_hz))
            found.append(HeldOutBlock(number, channel, time_s, float(np.sqrt(ratio)), p_value))
    return found


def _as_many_normal(noise: Real) -> float:
    """Return as how many samples of normal noise one of this noise tells of its power.

    The mean square of n samples scatters by sqrt((kurtosis - 1) / n) of itself. A kurtosis above 3 counts where it is
    beyond chance.
    """
    kurtosis = float(np.mean(noise**4)) / max(float(np.mean(noise**2)) ** 2, 1e-300)
    return 2 / (max(kurtosis - BY_CHANCE * math.sqrt(24 / noise.size), 3.0) - 1)


def _among(
    drawn: Real, error: Real, used: NDArray[np.bool_], at: NDArray[np.intp], fitted: float
) -> tuple[float, float]:
    """Return how the mean square of a block compares with that of what was fitted, among draws (draws, n) of noise.

    Noise of an input makes more where the motion is sensitive to it: its mean square there scatters as that of fewer
    samples.

    Parameters
    ----------
    fitted
        Weights of the whitening over samples that they were fitted to: by so much they make these errors smaller, which
        they do not the draws, and others larger.

    Returns
    -------
    tuple
        The ratio over the draws' mean, and its p-value.
    """
    shares = np.sum(drawn[:, at] ** 2, axis=1) / np.sum(drawn[:, used] ** 2, axis=1)
    larger = (1 + fitted) / (1 - fitted)
    ratio = float(np.sum(error[at] ** 2) / np.sum(error[used] ** 2) / np.mean(shares)) / larger
    freedom = min(2 * float(np.mean(shares) ** 2 / np.var(shares, ddof=1)), float(at.size))
    return ratio, float(chi2.sf(ratio * freedom, freedom))


def beyond_noise(errors: HeldOutErrors, problem: SimulatedRecordings) -> str:
    """Say in which block errors are furthest beyond noise, and how much; nothing where they are not."""
    policy = problem.policy
    if errors.p_value >= policy.level * policy.held_out_share:
        return ""
    worst = errors.worst()
    channel = problem.rig.seen[worst.channel].channel
    which = f" of recording {worst.recording + 1}" if len(problem.recordings) > 1 else ""
    first, last = worst.time_s
    return (
        f" Held-out errors are beyond noise: those of channel {channel} from {first:.4g} to {last:.4g} s{which} are "
        f"{worst.ratio:.3g} times what noise makes, in what cannot be predicted of them."
    )


def channel_errors(
    best: SimulatedFit, errors: HeldOutErrors, before: Real, after: Real | None
) -> tuple[ChannelErrors, ...]:
    """Return what is said of each channel, from rms ``before`` and ``after`` (channels,) and the best fit."""
    noise = noise_rms(best)
    return tuple(
        ChannelErrors(
            str(seen.channel),
            seen.unit,
            float(noise[i]),
            float(before[i]),
            None if after is None else float(after[i]),
            errors.ratio(i),
        )
        for i, seen in enumerate(best.problem.rig.seen)
    )
