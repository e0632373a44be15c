"""Control charts of a quantity that ought to stay as it is: EWMA and CUSUM of self-starting scores.

Each value is held against those before it:
``Q_n = Phi^-1(T_{n-2}(sqrt((n - 1) / n) (x_n - mean_{n-1}) / s_{n-1}))``, T Student's distribution, is standard normal
and independent of the others as long as nothing changes (Hawkins, 1987). So no first sessions have to be trusted
blindly, and the charts' false alarms are those of known parameters from the third value on. EWMA (Roberts, 1959) and
CUSUM (Page, 1954) of Q see small lasting changes that single values hide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from calibration.estimate import Estimate

Real = NDArray[np.float64]
WEIGHT = 0.2
"""Of the newest score in the EWMA."""

EWMA_LIMIT = 3.05
"""Times the standard deviation of the EWMA."""

ALLOWANCE, CUSUM_LIMIT = 0.5, 5.3
"""Of the CUSUM, in standard deviations: half of the change that it finds soonest, and where it tells."""

BETWEEN_FALSE_ALARMS = 470
"""Values from one false alarm to the next on average, both charts and both directions counted: 470 +- 11 by simulation
with the three limits above (``benchmarks/run_lengths.py``)."""

FEWEST = 3
"""Values from which on there is a score."""

BOUND = 8.0  # of a score: what lies beyond it is an alarm of any chart


@dataclass(frozen=True, slots=True)
class Change:
    """An alarm: the value that raised it, since which value (by the CUSUM), and by how much it changed.

    ``change`` is the mean of the values from ``since`` to the alarm less that before, with Welch's degrees of freedom;
    None where either are too few.
    """

    at: int
    since: int
    upwards: bool
    by_ewma: bool
    by_cusum: bool
    change: Estimate | None


@dataclass(frozen=True, slots=True)
class Chart:
    """The charts of (n,) values: scores, EWMA with its limit, CUSUM up and down; NaN before the third value."""

    values: Real
    scores: Real
    ewma: Real
    ewma_limit: Real
    up: Real
    down: Real
    alarms: tuple[Change, ...]


def chart(values: Sequence[float] | Real) -> Chart:
    """Return the charts of values in the order of time.

    After an alarm both begin anew with the next value, and scores are held against the values from ``since`` on: a
    change is told once, the next one again.

    Examples
    --------
    >>> steady = [1.0, 1.2, 0.9, 1.1, 1.0, 0.8, 1.1, 1.2, 1.0, 0.9]
    >>> [alarm.since for alarm in chart([*steady, *(v + 1 for v in steady)]).alarms]
    [10]
    """
    x = np.asarray(values, dtype=np.float64)
    n = len(x)
    scores, ewma, limit, up, down = (np.full(n, math.nan) for _ in range(5))
    alarms: list[Change] = []
    begun, steps = 0, 0
    z = high = low = 0.0
    rising = falling = 0  # where each CUSUM last left zero
    for i in range(n):
        score = _score(x[begun : i + 1])
        if math.isnan(score):
            continue
        steps += 1
        scores[i] = score
        z = (1 - WEIGHT) * z + WEIGHT * score
        width = EWMA_LIMIT * math.sqrt(WEIGHT / (2 - WEIGHT) * (1 - (1 - WEIGHT) ** (2 * steps)))
        rising, falling = (rising if high > 0 else i), (falling if low > 0 else i)
        high, low = max(0.0, high + score - ALLOWANCE), max(0.0, low - score - ALLOWANCE)
        ewma[i], limit[i], up[i], down[i] = z, width, high, low
        by_cusum = max(high, low) > CUSUM_LIMIT
        if abs(z) <= width and not by_cusum:
            continue
        upwards = high > low if by_cusum else z > 0
        since = rising if upwards else falling
        alarms.append(Change(i, since, upwards, abs(z) > width, by_cusum, _change(x[begun:since], x[since : i + 1])))
        begun, steps, z, high, low = since, 0, 0.0, 0.0, 0.0
    return Chart(x, scores, ewma, limit, up, down, tuple(alarms))


def _score(x: Real) -> float:
    """Score of the last value against those before it; NaN where these are too few or do not scatter."""
    n = len(x)
    if n < FEWEST:
        return math.nan
    before = x[:-1]
    spread = float(np.std(before, ddof=1))
    if spread <= 1e-12 * abs(float(before.mean())):
        return math.nan
    t = math.sqrt((n - 1) / n) * (float(x[-1]) - float(before.mean())) / spread
    tail = float(special.stdtr(n - 2, -abs(t)))
    return math.copysign(min(-float(special.ndtri(tail)), BOUND) if tail > 0 else BOUND, t)


def _change(before: Real, after: Real) -> Estimate | None:
    if len(before) < 2 or len(after) < 2:
        return None
    parts = [float(np.var(v, ddof=1)) / len(v) for v in (before, after)]
    variance = sum(parts)
    if variance == 0:
        return None
    dof = variance**2 / sum(p**2 / (len(v) - 1) for p, v in zip(parts, (before, after), strict=True))
    return Estimate(float(after.mean() - before.mean()), math.sqrt(variance), dof)


def run_lengths(shift: float, history: int, runs: int, longest: int, seed: int) -> NDArray[np.int64]:
    """Return after how many values of a lasting change an alarm came, simulated.

    Parameters
    ----------
    shift
        Of the mean, in standard deviations; 0: no change, and every alarm is a false one.
    history
        Values before the change, in which none raised an alarm (runs in which one did are drawn again).
    runs, longest
        How many, and where each is cut off.
    """
    noise = np.random.default_rng(seed)
    found: list[int] = []
    while len(found) < runs:
        values = noise.standard_normal((max(runs - len(found), 64), history + longest))
        values[:, history:] += shift
        for row in first_alarms(values):
            if row >= history:
                found.append(int(row) - history + 1)
    return np.array(found[:runs], dtype=np.int64)


def first_alarms(values: Real) -> NDArray[np.int64]:
    """Return the number of the value that first raised an alarm in each row of (r, n) values; n where none did."""
    rows, n = values.shape
    first = np.full(rows, n, dtype=np.int64)
    mean, square = values[:, 0].copy(), np.zeros(rows)
    z, high, low = np.zeros(rows), np.zeros(rows), np.zeros(rows)
    for i in range(1, n):
        x = values[:, i]
        count = i + 1
        if count >= FEWEST:
            t = np.sqrt((count - 1) / count) * (x - mean) / np.sqrt(square / (count - 2))
            tail = stats.t.sf(np.abs(t), count - 2)
            score = np.sign(t) * np.minimum(-special.ndtri(tail), BOUND)
            z = (1 - WEIGHT) * z + WEIGHT * score
            steps = count - FEWEST + 1
            width = EWMA_LIMIT * math.sqrt(WEIGHT / (2 - WEIGHT) * (1 - (1 - WEIGHT) ** (2 * steps)))
            high, low = np.maximum(0.0, high + score - ALLOWANCE), np.maximum(0.0, low - score - ALLOWANCE)
            told = (np.abs(z) > width) | (np.maximum(high, low) > CUSUM_LIMIT)
            first[told & (first == n)] = i
            if (first < n).all():
                break
        step = x - mean
        mean += step / count
        square += step * (x - mean)
    return first
