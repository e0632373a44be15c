"""What fits miss of blocks of the recordings: those that fit, those that choose, those that are held out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.noise import correlation
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, HELD


def independent_samples(fitted: SimulatedFit, part: int = CHOOSE) -> float:
    """Return how many independent samples of a fit's residual the blocks of a part hold; a block is one at least."""
    total = 0.0
    for number, recorded in enumerate(fitted.problem.recordings):
        off, at = fitted.off(number)
        kept = int(np.sum(recorded.part[at] == part))
        total += sum(kept / correlation(row[np.isin(recorded.part[at], (FIT, CHOOSE))]) for row in off)
    return max(total, float(len(fitted.by_block(part))))


def likelihood_ratio(before: SimulatedFit, after: SimulatedFit, best: SimulatedFit, factor: float = 1.0) -> float:
    """Return the logarithm of how much smaller the mean square becomes, times the independent samples.

    It takes all blocks that are not held out, with samples as independent as in what the ``best`` fit leaves. A
    ``factor`` is put on the mean squares after.
    """
    return sum(
        independent_samples(best, part)
        * math.log(mean_of(before.by_block(part)) / max(factor * mean_of(after.by_block(part)), 1e-300))
        for part in (FIT, CHOOSE)
    )


def mean_of(losses: Sequence[float]) -> float:
    """Return the mean square over blocks."""
    return float(np.mean(losses))


def held_out_rms(fitted: SimulatedFit) -> tuple[float, dict[str, float], int]:
    """Return the error on what was held out, in the recordings' unit: all, by declared stretch, how many pieces.

    The recordings are simulated from end to end: nothing is refitted on what was held out.
    """
    total, count, pieces = 0.0, 0, 0
    named: dict[str, list[float]] = {}
    for number, recorded in enumerate(fitted.problem.recordings):
        off, at = fitted.error(number, whole=True)
        kept = recorded.part[at] == HELD
        total, count = total + float(np.sum(off[:, kept] ** 2)), count + int(kept.sum()) * len(off)
        pieces += len(recorded.stretches) or np.unique(recorded.block[at][kept]).size
        for name, where in recorded.stretches:
            named.setdefault(name, []).append(float(np.mean(off[:, where] ** 2)))
    return (
        math.sqrt(total / count) if count else math.nan,
        {name: math.sqrt(float(np.mean(v))) for name, v in named.items()},
        pieces,
    )
