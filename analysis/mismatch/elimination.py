"""Unknowns taken out of normal equations."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from sim_backend.arrays import Real

SAFE = 1e-9  # squared pivot over a row's own size, above which a matrix is solved as it is


def eliminated(gram: Real, count: int, precision: Real) -> Real:
    """Return the Schur complement of the first ``count`` rows, (count,) being the precision they are known with."""
    a = gram[:count, :count].copy()
    a[np.arange(count), np.arange(count)] += precision
    scale = np.sqrt(np.maximum(np.diag(a), 1e-300))
    a, b = a / np.outer(scale, scale), gram[:count, count:] / scale[:, None]
    try:
        lower = np.linalg.cholesky(a)
        if np.diag(lower).min(initial=1.0) ** 2 > SAFE:
            half = np.asarray(solve_triangular(lower, b, lower=True, check_finite=False), np.float64)
            return np.asarray(gram[count:, count:] - half.T @ half, np.float64)
    except np.linalg.LinAlgError:
        pass
    out: Real = gram[count:, count:] - b.T @ np.linalg.lstsq(a, b, rcond=1e-12)[0]
    return out
