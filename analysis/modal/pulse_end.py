"""Where the pulse of a tap has ended, found from all taps of a load together.

From a start that is surely late each fit is extrapolated backwards. As long as the record is a free decay, what the
extrapolation misses it by is white noise of unit variance: innovations, each predicted from all later samples. The end
of a pulse is smooth, so that the first samples that still belong to it stand out of the noise of one record too little
to be seen there, and yet enough to move the poles by more than their standard errors. The taps of one impactor end
alike, counted from the trigger: their innovations together show what one alone hides, and a start that is
common to them hardly depends on the noise of any one of them, so that it does not favour records whose noise looks
like decay.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import special

from analysis.modal.exponentials import MAX_ITERATIONS, NONE_MISSING, ExponentialFit, forecast, search
from analysis.modal.sums import all_poles, no_tail, tail_of

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

LONE_BREAK = 5.0  # innovation of one record that no noise makes
COMMON_BREAK = 1e-6  # chance of the innovations of all records at one sample, below which the pulse is seen there
SUSPECT = 0.07  # chance of an innovation, beyond which it is rather the tail of the pulse than noise
SHORTEST_TAIL = 4  # samples next to where the pulse is seen that may be its tail, however early it is seen
GUARD = 1  # samples more: the tail may hide in the noise of all records, too
APART = 3  # samples by which a record may break later than most and still be one of them
STEPS = 12  # of a fit to a few samples and a tail
ROUNDING = 1e-16  # of a record's power: less noise than that is taken for this much


def innovations(
    y: Real,
    trigger: int,
    safe: int,
    fit: ExponentialFit,
    known: Complex,
    noise_variance: float,
    missing: NDArray[np.int64] = NONE_MISSING,
) -> Real:
    """Return how far each sample before ``safe`` is from the prediction by all later ones, in standard deviations.

    Parameters
    ----------
    y
        (n,) whitened record.
    trigger, safe
        Sample of the trigger, and one after the pulse from which ``fit`` begins.
    fit
        Fit of ``y[safe:]``.
    known
        Its known poles.
    noise_variance
        Of the whitened record; the residual's is taken where that is larger, or this one unknown.
    missing
        Samples of ``y`` from ``safe`` on that are left out.

    Returns
    -------
    (t,) innovations of the samples ``safe - 1``, ``safe - 2``, ...; ends with the first that is not noise.
    """
    variance = max(float(fit.noise_variance[0]), ROUNDING * float(np.mean(y[safe:] ** 2)))
    if noise_variance > 0:
        variance = max(variance, noise_variance)
    left_out = missing[missing >= safe]
    record = np.ascontiguousarray(y, dtype=np.float64)
    if left_out.size:
        record = record.copy()
        record[left_out] = 0.0
    try:
        return _innovations(record, trigger, safe, fit.poles, known, variance, left_out)
    except np.linalg.LinAlgError:
        return np.zeros(0)  # nothing can be told of what was before


@njit(cache=True)
def _innovations(
    y: Real, trigger: int, safe: int, poles: Complex, known: Complex, variance: float, missing: NDArray[np.int64]
) -> Real:
    """As `innovations`; the record is fitted anew with every block of samples that is taken in.

    What follows ``safe`` counts as power series about the poles found there: most fits look at no more samples than the
    few before.
    """
    found = np.empty(safe)
    count, start, anchor = 0, safe, safe
    moving, one = 2 * poles.shape[0], np.ones(1)
    tail = tail_of(y[None, anchor:], poles, known, variance)
    settled, _, poles, amplitude, _ = search(y[None, anchor:anchor], tail, one, poles, known, missing - anchor, STEPS)
    while settled and start > trigger + 2:
        block = min(max(2, (start - trigger) // 6), start - trigger - 1)
        k = -np.arange(1, block + 1)
        z = all_poles(poles, known)
        predicted, covariance = forecast(z, amplitude[0], moving, k, y.size - start, missing - start)
        # the rows of the Cholesky factor condition each sample on those after it
        root = np.linalg.cholesky(variance * (np.eye(block) + covariance))
        for i in range(block):
            score = y[start - 1 - i] - predicted[i]
            for b in range(i):
                score -= root[i, b] * found[count - i + b]
            found[count] = score / root[i, i]
            count += 1
            if not np.abs(found[count - 1]) <= LONE_BREAK:
                return found[:count]
        start -= block
        settled, _, new, amplitude, _ = search(y[None, start:anchor], tail, one, poles, known, missing - start, STEPS)
        if not settled:  # beyond the reach of the series, perhaps
            settled, _, new, amplitude, _ = search(
                y[None, start:], no_tail(1), one, poles, known, missing - start, MAX_ITERATIONS
            )
            anchor = start
            tail = tail_of(y[None, anchor:], new, known, variance)
        poles = new
    return found[:count]


def samples_before(scores: Sequence[Real], ahead: int) -> list[int]:
    """How many samples before the safe one each record may begin, from the innovations of all of them.

    Records whose innovations break off much later than those of most (a second impact, say) are judged on their own.

    Parameters
    ----------
    scores
        Innovations of each record.
    ahead
        Samples between trigger and safe start.
    """
    if not scores:
        return []
    reach = np.array([s.size for s in scores])
    alone = reach < np.median(reach) - APART
    common = _usable([s for s, a in zip(scores, alone, strict=True) if not a], ahead)
    return [_usable([s], ahead) if a else common for s, a in zip(scores, alone, strict=True)]


def _usable(scores: Sequence[Real], ahead: int) -> int:
    """Samples before the safe one that are free decay in all of these records."""
    length = min(s.size for s in scores)
    z = np.array([s[:length] for s in scores])
    m = len(scores)
    # the pulses push the same way: a sum sees what they share, a sum of squares what they do not
    shared, each = z.sum(axis=0) ** 2 / m, (z**2).sum(axis=0)
    chance = 2 * np.minimum(special.chdtrc(1, shared), special.chdtrc(m, each))
    broken = np.flatnonzero(~(chance > COMMON_BREAK))
    end = int(broken[0]) if broken.size else length
    # what is not seen of a pulse is no longer than what is
    first = max(0, end - max(SHORTEST_TAIL, ahead - end))
    # a fit that takes in the first traces of the pulse predicts more of it: the chi-squared of all samples up to where
    # it is seen counts, not that of the last one
    usable = min(
        first + int(np.argmin(np.append(0.0, np.cumsum(square[first:end] - special.chdtri(dof, SUSPECT)))))
        for square, dof in ((shared, 1), (each, m))
    )
    return max(0, usable - GUARD)
