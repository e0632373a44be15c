"""Which samples of rows are wrong by themselves: what says so, whatever told that they are odd."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import kstest, norm, poisson, rankdata

from analysis.mismatch.recordings.thinning import RINGING, kernel, smoothed
from sim_backend.arrays import Real

NORMAL_MEDIAN: Final = 0.6745  # of the magnitude of normal noise, in standard deviations
CLOSE: Final = 3  # samples within which wrong ones are close to each other
MOST: Final = 0.05  # of a channel's samples that may be wrong by themselves (errors of Student's t, 3 degrees: 0.008)

MOST_BEFORE: Final = 2000  # samples of a recording that are put right before it is thinned out: more take long to find


@dataclass(frozen=True, slots=True)
class Outlier:
    """A sample of a channel that is off by a size (in the channel's unit), and over the noise (rms)."""

    channel: int
    sample: int
    size: float
    over_noise: float


def by_themselves(found: Sequence[Outlier], shown: Real, level: float, anywhere: bool = False) -> bool:
    """Whether wrong samples are few, lie as far from each other as by chance, and come whatever the rig does.

    What a rig does lasts, and shows in several channels; what clips, jumps or hits does so where motion is large, turns
    about or is fast.

    Parameters
    ----------
    shown
        (c, n) what the rig does.
    level
        p-value from which on chance has done it.
    anywhere
        Whether it does not matter where motion is large.
    """
    channels, n = shown.shape
    if len(found) > MOST * n * channels:
        return False
    times = np.sort([w.sample for w in found])
    pairs = int(np.sum(np.searchsorted(times, times + CLOSE, "right") - np.arange(times.size) - 1))
    by_chance = times.size * (times.size - 1) / 2 * (2 * CLOSE + 1) / n
    if pairs and poisson.sf(pairs - 1, by_chance) < level:
        return False
    if anywhere:
        return True
    ranks = [rankdata(np.abs(row - row.mean())) / n for row in shown]
    return float(kstest([ranks[w.channel][w.sample] for w in found], "uniform").pvalue) > level


def put_right_before_thinning(rows: Real, factor: int, region: slice, level: float) -> tuple[Real, list[Outlier]]:
    """Return rows (c, n) without the samples of a region that are wrong by themselves, and these.

    What is taken away before rows are thinned out is noise, and a wrong sample stands out in it; the filter would
    spread it over two or three.
    """
    weights = kernel(factor)
    middle, right = weights.size // 2, rows.copy()
    found: list[Outlier] = []
    edge = slice(region.start, min(region.stop, rows.shape[1] - RINGING * factor))
    count = edge.stop - edge.start
    if count <= 0:
        return rows, []
    taken, limit = -weights, float(norm.isf(level / (2 * rows.shape[0] * count)))
    taken[middle] += 1.0
    for channel, (row, beyond) in enumerate(zip(right, rows - smoothed(rows, factor), strict=True)):
        error = float(np.median(np.abs(beyond[edge]))) / NORMAL_MEDIAN
        while len(found) < min(MOST * count, MOST_BEFORE):
            i = edge.start + int(np.argmax(np.abs(beyond[edge])))
            if not abs(beyond[i]) > limit * error > 0:
                break
            size = float(beyond[i] / taken[middle])
            row[i] -= size
            seen = slice(max(i - middle, 0), min(i + middle + 1, row.size))
            beyond[seen] -= size * taken[seen.start - i + middle : seen.stop - i + middle]
            noise = error / math.sqrt(float(taken @ taken))
            found.append(Outlier(channel, i - edge.start, size, abs(size) / noise))
    if not 0 < len(found) < MOST_BEFORE or not by_themselves(found, right[:, edge], level):
        return rows, []
    return right, [Outlier(w.channel, w.sample + edge.start, w.size, w.over_noise) for w in found]
