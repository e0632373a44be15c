"""What fits miss of blocks of the recordings: those that fit, those that choose, those that are held out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np
from scipy.stats import norm

from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.noise import correlation, noise_of
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, HELD, Recorded
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import SecondImpact

ODD: Final = 3.0  # times the largest error that is not held out (one clipped peak: 43; noise of four rigs: 0.3 to 1.4)
NO_WORSE: Final = 1.02  # held-out errors of an impact over those without it, by chance (recordings of decision 159)


def fitted_where_odd(linear: SimulatedFit, divided: Sequence[Recorded]) -> tuple[Recorded, ...]:
    """Return recordings divided such that what the linear rig misses by far most in a held-out block is fitted.

    Those that are ``divided`` otherwise than they were for the linear rig stay as they are.

    A channel that clips at its highest peak does so once: where that is held out, nothing that is fitted shows it.
    """
    found = []
    for number, (recorded, anew) in enumerate(zip(linear.problem.recordings, divided, strict=True)):
        off, at = linear.off(number)
        part, samples = recorded.part[at], np.arange(recorded.samples)[at]
        held, seen = (np.abs(off) * np.isin(part, parts) for parts in ((HELD,), (FIT, CHOOSE)))
        over = np.max(held / np.maximum(seen.max(axis=1, keepdims=True), 1e-300), axis=0)
        odd = anew is recorded and over.max() > ODD
        found.append(recorded.fitted_at(int(samples[np.argmax(over)])) if odd else anew)
    return tuple(found)


def independent_samples(fitted: SimulatedFit, part: int = CHOOSE, whitened: bool = False) -> float:
    """Return how many independent samples of a fit's residual the blocks of a part hold; a block is one at least."""
    total = 0.0
    for number, recorded in enumerate(fitted.problem.recordings):
        off, at = fitted.off(number)
        rows = fitted.noise(number).white(off) if whitened else off
        kept = int(np.sum(recorded.part[at] == part))
        total += sum(kept / correlation(row[np.isin(recorded.part[at], (FIT, CHOOSE))]) for row in rows)
    return max(total, float(len(fitted.by_block(part))))


def likelihood_ratio(before: SimulatedFit, after: SimulatedFit, best: SimulatedFit, factor: float = 1.0) -> float:
    """Return the logarithm of how much smaller the mean square becomes, times the independent samples.

    It takes all blocks that are not held out; see `ratio_in`. A ``factor`` is put on the mean squares after.
    """
    return sum(ratio_in(part, before, after, best, factor) for part in (FIT, CHOOSE))


def ratio_in(part: int, before: SimulatedFit, after: SimulatedFit, best: SimulatedFit, factor: float = 1.0) -> float:
    """Return the `likelihood_ratio` of one part's blocks, with samples as independent as in what ``best`` leaves.

    Where that is as good as noise, residuals are whitened as this noise asks: of slow noise a few samples count as
    independent, and what is fast beside it would be lost in them.
    """
    count, (first, last) = _left_in(part, before, after, best)
    return count * math.log(first / max(factor * last, 1e-300))


def _left_in(
    part: int, before: SimulatedFit, after: SimulatedFit, best: SimulatedFit
) -> tuple[float, tuple[float, float]]:
    """Return how many independent samples a part's blocks hold, and what two fits leave in them; see `ratio_in`."""
    noise = best if best.as_noise else None
    left = mean_of(before.by_block(part, noise)), mean_of(after.by_block(part, noise))
    return independent_samples(best, part, noise is not None), left


def of_least_noise(
    fits: Iterable[SimulatedFit], weight: Callable[[SimulatedFit], float] = lambda _: 1.0
) -> SimulatedFit:
    """Return the fit that leaves least, with weights on mean squares; of those as good as noise, what is unpredicted.

    What inputs' noise makes, or slow noise, hides in what is left what is small and told well by several channels, or
    by what is fast.
    """
    fits = list(fits)
    nearest = min(fits, key=lambda f: weight(f) * f.scatter)
    most = nearest.problem.policy.unlike_noise * weight(nearest) * nearest.scatter
    if nearest.little_predicted and nearest.problem.noise <= 1:
        return nearest
    alike = [f for f in fits if weight(f) * f.scatter < most and f.as_noise]
    return min(alike, key=lambda f: weight(f) * _unpredicted(f)) if alike else nearest


def _unpredicted(fitted: SimulatedFit) -> float:
    each = [math.log(fitted.noise(i).unpredicted) for i in range(len(fitted.own))]
    return math.exp(np.average(each, weights=[rows.size for rows in fitted.residuals]))


def mean_of(losses: Sequence[float]) -> float:
    """Return the mean square over blocks."""
    return float(np.mean(losses))


def held_out_rms(fitted: SimulatedFit) -> tuple[Real, dict[str, Real], int]:
    """Return (channels,) errors on what was held out: all, by declared stretch, and how many pieces it has.

    The recordings are simulated from end to end: nothing is refitted on what was held out.
    """
    total, count, pieces = np.zeros(len(fitted.problem.rig.seen)), 0, 0
    named: dict[str, list[Real]] = {}
    for number, recorded in enumerate(fitted.problem.recordings):
        off, at = fitted.error(number, whole=True)
        kept = recorded.part[at] == HELD
        total, count = total + np.sum(off[:, kept] ** 2, axis=1), count + int(kept.sum())
        pieces += len(recorded.stretches) or np.unique(recorded.block[at][kept]).size
        for name, where in recorded.stretches:
            named.setdefault(name, []).append(np.mean(off[:, where] ** 2, axis=1))
    return (
        np.sqrt(total / count) if count else np.full(total.size, math.nan),
        {name: np.sqrt(np.mean(v, axis=0)) for name, v in named.items()},
        pieces,
    )


def noise_rms(fitted: SimulatedFit) -> Real:
    """Return (channels,) the rms of noise in a fit's errors: of what cannot be predicted of them where they are seen.

    Where inputs have noise, of what that makes and the channels' own.
    """
    recordings = fitted.problem.recordings
    found = [_noise_in(fitted, i, r) for i, r in enumerate(recordings)]
    lengths = [r.fitted.stop - r.fitted.start for r in recordings]
    return np.asarray(np.sqrt(np.average(np.array(found) ** 2, axis=0, weights=lengths)), np.float64)


def _noise_in(fitted: SimulatedFit, number: int, recorded: Recorded) -> Real:
    driven = fitted.noise(number).driven
    if driven is None:
        return noise_of(recorded, *fitted.error(number))
    return np.asarray(recorded.unit * np.sqrt(driven.power + driven.white), np.float64)


def over_noise(fitted: SimulatedFit) -> float:
    """Return the errors of a fit on what was held out, of the channel with most, over what noise makes."""
    return float(np.max(held_out_rms(fitted)[0] / noise_rms(fitted)))


def predicts_no_better(before: SimulatedFit, after: SimulatedFit) -> bool:
    """Whether one fit's errors on what was held out are no smaller than another one's; False where nothing was.

    Where what it leaves is as good as noise, errors are weighed as that noise asks, and larger ones count where noise
    would make them so in fewer recordings, were the fit right, than `SelectionPolicy.level`: what an effect does there
    may be less than noise. An impact happened once, elsewhere, and may have died out there: it must only not be much
    worse.
    """
    once = bool(after.terms) and all(isinstance(t.mechanism, SecondImpact) for t in after.terms)
    if after.as_noise and not once:
        return _falls_too_little(HELD, before, after)
    held = before.by_block(HELD, after) if after.as_noise else ()
    if held:
        ratio = math.sqrt(mean_of(after.by_block(HELD, after)) / mean_of(held))
    else:
        ratio = float(np.mean(held_out_rms(after)[0] / held_out_rms(before)[0]))
    return ratio > (NO_WORSE if once else 1)


def chooses_no_worse(before: SimulatedFit, after: SimulatedFit) -> bool:
    """Whether a fit's errors on the choosing blocks are no larger than another one's, but for what noise makes of them.

    What happens rarely, such as clipping at the highest peak, may happen in no choosing block.
    """
    parameters = sum(len(t.mechanism.parameters) for t in after.terms) - sum(
        len(t.mechanism.parameters) for t in before.terms
    )
    if ratio_in(CHOOSE, before, after, after) > -after.problem.policy.parameter_cost * parameters:
        return True
    return after.as_noise and not _falls_too_little(CHOOSE, before, after)


def _falls_too_little(part: int, before: SimulatedFit, after: SimulatedFit) -> bool:
    fall, made, by_chance = fall_in(part, before, after)
    return fall < min(made - by_chance, 0.0)


def untold_words(before: SimulatedFit, after: SimulatedFit) -> str:
    """Say that what was held out does not tell two fits apart, where noise hides what makes the difference."""
    if not after.as_noise:
        return ""
    _, made, by_chance = fall_in(HELD, before, after)
    if not 0 < made < by_chance:
        return ""
    return " What was held out does not show what is named: noise hides what that does there."


def fall_in(part: int, before: SimulatedFit, after: SimulatedFit) -> tuple[float, float, float]:
    """Return by how much the squares of a part's blocks fall from one fit to another, and what is to be expected.

    Whitened as the noise asks that the better one leaves: where the second fit is right, they fall by the squares of
    what makes the difference, the second number, on average; in one of a hundred recordings by less than that by the
    third (`SelectionPolicy.level`). The blocks scatter by their noise, the fit by that of what it was fitted to.
    """
    fall = made = 0.0
    count, best = {part: 0, FIT: 0}, of_least_noise((before, after))
    for number, recorded in enumerate(after.problem.recordings):
        (first, at), (last, _) = before.off(number), after.off(number)
        held = recorded.part[at] == part
        old, new = (best.noise(number).white(off)[:, held] for off in (first, last))
        fall += float(np.sum(old**2) - np.sum(new**2))
        made += float(np.sum((old - new) ** 2))
        count[part] += int(np.sum(held))
        count[FIT] += int(np.sum(np.isin(recorded.part[at], after.parts)))
    spread = 2 * math.sqrt(made * (1 + count[part] / max(count[FIT], 1)))
    return fall, made, float(norm.isf(after.problem.policy.level)) * spread


def missed_still(before: SimulatedFit, after: SimulatedFit) -> float:
    """Return the share of the mean square of one fit's held-out errors that another one's have, far over the noise.

    Zero where they are not far over it: by itself noise may be as slow as the rig is.
    """
    if not over_noise(after) > after.problem.policy.far_over_noise:
        return 0.0
    beyond = np.maximum(held_out_rms(after)[0] ** 2 - noise_rms(after) ** 2, 0.0)
    return float(np.mean(beyond / held_out_rms(before)[0] ** 2))


def share_by_scores(before: SimulatedFit, after: SimulatedFit, unexplained: float) -> float:
    """Return the share of what one fit misses that another one leaves, by a chi-squared ``unexplained`` that is left.

    Where so little is left that no forces of any shape were fitted. Whitening hides what is far over noise: there
    `missed_still` tells.
    """
    gained = 0.0
    for part in (FIT, CHOOSE):
        count, (first, last) = _left_in(part, before, after, after)
        gained += count * max(first / max(last, 1e-300) - 1, 0.0)  # chi-squared: its logarithm grows much slower
    return unexplained / max(gained + unexplained, 1e-300)


def together(fitted: SimulatedFit, rms: Real) -> float:
    """Return the rms (channels,) of all channels that have the first one's unit as one."""
    seen = fitted.problem.rig.seen
    return float(np.sqrt(np.mean(rms[[s.unit == seen[0].unit for s in seen]] ** 2)))


def p_of_colour(fitted: SimulatedFit) -> tuple[float, ...]:
    """Return the p-value of `p_of_sensor_noise` where held-out errors are far over noise; nothing elsewhere.

    Nothing either where most of the motion is missed: that is the rig's description, and no law is looked for.
    """
    far = over_noise(fitted) > fitted.problem.policy.slow_over_noise and not fitted.far_off()
    return (fitted.p_of_colour,) if far and not math.isnan(fitted.p_of_colour) else ()
