"""Linear equations of the fits: solved by least squares, unknowns taken out."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from sim_backend.arrays import Real

SAFE = 1e-9  # squared pivot over a row's own size, above which a matrix is solved as it is


def solved(a: Real, b: Real, rcond: float) -> Real:
    """Return the least-squares solution of ``a @ x = b``, the smallest one where there are several.

    Where a trial of a force law runs away there is none, and it consists of NaN; LAPACK would print that as well.

    Raises
    ------
    numpy.linalg.LinAlgError
        A number of the matrix is not finite.
    """
    if not np.isfinite(a).all():
        raise np.linalg.LinAlgError("a matrix with numbers that are not finite")
    if not np.isfinite(b).all():
        return np.full((a.shape[1], *b.shape[1:]), np.nan)
    return np.asarray(np.linalg.lstsq(a, b, rcond=rcond)[0], np.float64)


def eliminated(gram: Real, count: int, precision: Real) -> Real:
    """Return the Schur complement of the first ``count`` rows, (count,) being the precision they are known with."""
    return eliminated_and_taken(gram, count, precision)[0]


def eliminated_and_taken(gram: Real, count: int, precision: Real) -> tuple[Real, Real]:
    """Return the Schur complement of the first ``count`` rows, and (m,) what they take of the diagonal.

    Of a gram (count + r, count + m) with fewer rows than columns: the first r rows of it.
    """
    rows = len(gram) - count
    a = gram[:count, :count].copy()
    a[np.arange(count), np.arange(count)] += precision
    scale = np.sqrt(np.maximum(np.diag(a), 1e-300))
    a, b = a / np.outer(scale, scale), gram[:count, count:] / scale[:, None]
    try:
        lower = np.linalg.cholesky(a)
        if np.diag(lower).min(initial=1.0) ** 2 > SAFE:
            half = np.asarray(solve_triangular(lower, b, lower=True, check_finite=False), np.float64)
            return gram[count:, count:] - half[:, :rows].T @ half, np.sum(half**2, axis=0)
    except np.linalg.LinAlgError:
        pass
    made = solved(a, b, rcond=1e-12)
    return gram[count:, count:] - b[:, :rows].T @ made, np.sum(b * made, axis=0)
