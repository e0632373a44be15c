"""Autoregressive model of the recorder's noise, fitted to the samples before the trigger, and whitening by it.

An autoregressive model whitens the record: a ring-down filtered by it is a ring-down with the same poles, and
least squares on what comes out is maximum likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

Real = NDArray[np.float64]

LARGEST_ORDER = 8


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Autoregressive noise ``e_k + a_1 e_(k-1) + ... + a_p e_(k-p) = w_k`` with white w.

    Attributes
    ----------
    coefficients
        (p + 1,) the polynomial, beginning with 1; ``[1.]`` for white noise.
    variance
        Variance of w; NaN where nothing is known of the noise.
    """

    coefficients: Real
    variance: float

    @property
    def order(self) -> int:
        """How many samples at the beginning of a whitened record are lost."""
        return self.coefficients.size - 1

    def whiten(self, y: Real) -> Real:
        """Filter ``y`` (..., n) to (..., n - order), in which the noise is white."""
        if self.order == 0:
            return y
        filtered: Real = signal.lfilter(self.coefficients, [1.0], y, axis=-1)[..., self.order :]
        return filtered


WHITE = NoiseModel(np.ones(1), float("nan"))


def noise_model(stretches: Sequence[Real], largest_order: int = LARGEST_ORDER) -> NoiseModel:
    """Fit the noise model to segments without signal (Yule-Walker; order by the Bayesian information criterion).

    Parameters
    ----------
    stretches
        One-dimensional records of noise; each is taken about its own mean.

    Examples
    --------
    >>> import numpy as np
    >>> white = np.random.default_rng(1).standard_normal(100_000)
    >>> from scipy.signal import lfilter
    >>> found = noise_model([lfilter([1.0], [1.0, -0.8], white)], largest_order=1)
    >>> np.round(found.coefficients, 2)
    array([ 1. , -0.8])
    """
    usable = [np.asarray(s, np.float64) - np.mean(s) for s in stretches if len(s) >= 4 * largest_order]
    total = sum(s.size for s in usable)
    if total < 20 * largest_order:
        return WHITE
    lags = np.zeros(largest_order + 1)
    for s in usable:
        for lag in range(largest_order + 1):
            lags[lag] += np.dot(s[: s.size - lag], s[lag:])
    lags /= total
    if not lags[0] > 0:
        return WHITE
    best, best_score = NoiseModel(np.ones(1), float(lags[0])), total * np.log(lags[0])
    for order in range(1, largest_order + 1):
        a = linalg.solve_toeplitz(lags[:order], -lags[1 : order + 1])
        variance = float(lags[0] + np.dot(a, lags[1 : order + 1]))
        if not variance > 0:
            break
        score = total * np.log(variance) + order * np.log(total)
        if score < best_score:
            best, best_score = NoiseModel(np.concatenate(([1.0], a)), variance), score
    return best
