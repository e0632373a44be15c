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

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats

from analysis.modal.exponentials import ExponentialFit, predict

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]
Refit = Callable[[Real, int, Complex], ExponentialFit | None]

LONE_BREAK = 5.0  # innovation of one record that no noise makes
COMMON_BREAK = 1e-6  # chance of the innovations of all records at one sample, below which the pulse is seen there
SUSPECT = 0.07  # chance of an innovation, beyond which it is rather the tail of the pulse than noise
SHORTEST_TAIL = 4  # samples next to where the pulse is seen that may be its tail, however early it is seen
GUARD = 1  # samples more: the tail may hide in the noise of all records, too
APART = 3  # samples by which a record may break later than most and still be one of them
ROUNDING = 1e-16  # of a record's power: less noise than that is taken for this much


def innovations(
    y: Real, trigger: int, safe: int, fit: ExponentialFit, known: Complex, noise_variance: float, refit: Refit
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
    refit
        Fits a record from a sample on, from given poles.

    Returns
    -------
    (t,) innovations of the samples ``safe - 1``, ``safe - 2``, ...; ends with the first that is not noise.
    """
    start = safe
    variance = max(float(fit.noise_variance[0]), ROUNDING * float(np.mean(y[start:] ** 2)))
    if noise_variance > 0:
        variance = max(variance, noise_variance)
    found: list[float] = []
    while start > trigger + 2:
        block = min(max(2, (start - trigger) // 6), start - trigger - 1)
        k = -np.arange(1, block + 1)
        predicted, covariance = predict(fit, k, y.size - start, known)
        # the rows of the Cholesky factor condition each sample on those after it
        root = linalg.cholesky(variance * (np.eye(block) + covariance), lower=True)
        score = linalg.solve_triangular(root, y[start + k] - predicted, lower=True)
        broken = np.flatnonzero(~(np.abs(score) <= LONE_BREAK))
        if broken.size:
            found += score[: broken[0] + 1].tolist()
            break
        found += score.tolist()
        earlier = refit(y, start - block, fit.poles)
        if earlier is None:
            break
        fit, start = earlier, start - block
    return np.array(found)


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
    chance = 2 * np.minimum(stats.chi2.sf(shared, 1), stats.chi2.sf(each, m))
    broken = np.flatnonzero(~(chance > COMMON_BREAK))
    end = int(broken[0]) if broken.size else length
    # what is not seen of a pulse is no longer than what is
    first = max(0, end - max(SHORTEST_TAIL, ahead - end))
    # a fit that takes in the first traces of the pulse predicts more of it: the chi-squared of all samples up to where
    # it is seen counts, not that of the last one
    usable = min(
        first + int(np.argmin(np.append(0.0, np.cumsum(square[first:end] - stats.chi2.isf(SUSPECT, dof)))))
        for square, dof in ((shared, 1), (each, m))
    )
    return max(0, usable - GUARD)
