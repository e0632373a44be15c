"""The Eigensystem Realization Algorithm (Juang and Pappa 1985; Sec. 3.4 of the paper) with uncertainties.

From a ring-down ``y`` of c channels the block Hankel matrices ``H0[i, j] = y[i + j]`` and ``H1[i, j] = y[i + j + 1]``
are formed; ``H0 = U S V^T`` truncated to the model order gives ``A = S^-1/2 U^T H1 V S^-1/2``, whose eigenvalues are
the sampled poles. Neither matrix is ever stored: ``H0 H0^T`` and ``H1 H0^T`` follow from one row by a recursion along
their diagonals, and their size is that of the lags, not of the record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from analysis.modal.exponentials import FitFailure

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Realisation:
    """Modes of one model order.

    Attributes
    ----------
    poles
        (m,) sampled poles with positive imaginary part, ascending in frequency.
    shapes
        (c, m) complex amplitudes at the first sample, a channel a row.
    log_pole_covariance
        (m, 2, 2) first-order covariance of real and imaginary part of ``log z`` in white noise.
    emac
        (m,) extended modal amplitude coherence: how well a later lag (where the mode has fallen to 1/e, or the
        last one) continues the first, 0 to 1.
    mpc
        (m,) modal phase collinearity of the shapes, 0 to 1 (1 for a single channel).
    singular_values
        (r,) singular values of H0, descending.
    order
        Model order (twice the number of oscillating modes, and real poles).
    """

    poles: Complex
    shapes: Complex
    log_pole_covariance: Real
    emac: Real
    mpc: Real
    singular_values: Real
    order: int


@njit(cache=True)
def _hankel_products(y: Real, lags: int, columns: int) -> tuple[Real, Real]:
    """``H0 H0^T`` and ``H1 H0^T``, (lags c, lags c): row i c + a is channel a at lag i."""
    c = y.shape[0]
    size = lags * c
    g0 = np.empty((size, size))
    g1 = np.empty((size, size))
    for a in range(c):
        for b in range(c):
            for i in range(lags + 1):
                first = np.dot(y[a, i : i + columns], y[b, :columns])
                if i < lags:
                    g0[i * c + a, b] = first
                if i > 0:
                    g1[(i - 1) * c + a, b] = first
    for a in range(c):
        for b in range(c):
            for i in range(lags):
                for j in range(1, lags):
                    # down a diagonal one product enters and one leaves
                    if i > 0:
                        gain = y[a, i - 1 + columns] * y[b, j - 1 + columns] - y[a, i - 1] * y[b, j - 1]
                        g0[i * c + a, j * c + b] = g0[(i - 1) * c + a, (j - 1) * c + b] + gain
                        gain = y[a, i + columns] * y[b, j - 1 + columns] - y[a, i] * y[b, j - 1]
                        g1[i * c + a, j * c + b] = g1[(i - 1) * c + a, (j - 1) * c + b] + gain
                    else:
                        g0[a, j * c + b] = g0[j * c + b, a]
                        gain = y[a, columns] * y[b, j - 1 + columns] - y[a, 0] * y[b, j - 1]
                        g1[a, j * c + b] = g0[(j - 1) * c + b, a] + gain
    return g0, g1


@dataclass(frozen=True, slots=True)
class HankelSvd:
    """Singular vectors of the Hankel matrix of one record, from which any order is realised.

    Attributes
    ----------
    vectors
        (lags c, lags c) left singular vectors, strongest first.
    singular_values
        (lags c,) singular values.
    shifted
        ``H1 H0^T``.
    record
        (c, n) the record itself; of several, the first.
    lags, columns
        Block rows and columns of the Hankel matrix.
    """

    vectors: Real
    singular_values: Real
    shifted: Real
    record: Real
    lags: int
    columns: int


def hankel_svd(y: Real, lags: int | None = None) -> HankelSvd:
    """Return the singular vectors and values of the block Hankel matrix of one ring-down, or of several side by side.

    Parameters
    ----------
    y
        (c, n) ring-down, free decay only; or (m, c, n), m of them with the same modes.
    lags
        Block rows; by default a third of the record, at most 240 / sqrt(c).

    Raises
    ------
    FitFailure
        If the record is too short for the lags or holds nothing but zeros.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 1e4
    >>> y = np.exp(-20 * t) * np.sin(2 * np.pi * 300 * t)
    >>> singular = hankel_svd(y).singular_values
    >>> int(np.count_nonzero(singular > 1e-6 * singular[0]))
    2
    """
    y = np.ascontiguousarray(np.atleast_2d(y), dtype=np.float64)
    several = y if y.ndim == 3 else y[None]
    c, n = several.shape[1:]
    rows = lags if lags is not None else min(n // 3, int(240 / np.sqrt(c)))
    columns = n - rows
    if rows < 4 or columns < rows:
        raise FitFailure(f"{n} samples are too few for the Eigensystem Realization Algorithm")
    g0, g1 = _hankel_products(several[0], rows, columns)
    for record in several[1:]:
        more0, more1 = _hankel_products(record, rows, columns)
        g0 += more0
        g1 += more1
    values, vectors = np.linalg.eigh(g0)
    singular = np.sqrt(np.clip(values[::-1], 0.0, None))
    if not singular[0] > 0:
        raise FitFailure("the record holds nothing but zeros")
    return HankelSvd(np.ascontiguousarray(vectors[:, ::-1]), singular, g1, several[0], rows, columns)


def realise(decomposed: HankelSvd, order: int, noise_variance: float = 0.0) -> Realisation:
    """ERA of one model order.

    Parameters
    ----------
    decomposed
        From `hankel_svd`.
    order
        Number of states.
    noise_variance
        Variance of the white noise on each channel, for the covariance of the poles.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 1e4
    >>> y = np.exp(-20 * t) * np.sin(2 * np.pi * 300 * t)
    >>> pole = realise(hankel_svd(y), order=2).poles[0]
    >>> s = np.log(pole) * 1e4
    >>> round(s.real, 3), round(s.imag / (2 * np.pi), 3)
    (np.float64(-20.0), np.float64(300.0))
    """
    c = decomposed.record.shape[0]
    u, s = decomposed.vectors[:, :order], decomposed.singular_values[:order]
    if order > s.size or s[-1] <= s[0] * 1e-13:
        order = int(np.count_nonzero(s > s[0] * 1e-13))
        u, s = u[:, :order], s[:order]
    root = np.sqrt(s)
    a_matrix = (u.T @ decomposed.shifted @ u) / (root[:, None] * (root * s)[None, :])
    values, right = np.linalg.eig(a_matrix)
    left = np.linalg.inv(right)  # rows: left eigenvectors with l r = 1
    keep = np.flatnonzero((values.imag > 1e-9) & (np.abs(values) < 1.5))
    keep = keep[np.argsort(np.abs(np.angle(values[keep])))]
    observability = (u * root) @ right  # (lags c, order)
    first_states = left @ _first_column(decomposed, u, root)
    poles = values[keep].astype(np.complex128)
    shapes = observability[:c, keep] * first_states[keep][None, :]
    covariance = np.zeros((keep.size, 2, 2))
    emac = np.empty(keep.size)
    for m, index in enumerate(keep):
        decay = -np.log(np.abs(values[index]))
        lag = decomposed.lags - 1 if decay * (decomposed.lags - 1) <= 1 else max(1, int(1 / decay))
        predicted = observability[:c, index] * values[index] ** lag
        emac[m] = _coherence(predicted, observability[lag * c : (lag + 1) * c, index])
        if noise_variance > 0:
            covariance[m] = _pole_covariance(decomposed, u, root, left[index], right[:, index], values[index])
    return Realisation(
        poles=poles,
        shapes=np.ascontiguousarray(shapes, dtype=np.complex128),
        log_pole_covariance=covariance * noise_variance,
        emac=emac,
        mpc=_phase_collinearity(shapes),
        singular_values=decomposed.singular_values,
        order=order,
    )


def _first_column(decomposed: HankelSvd, u: Real, root: Real) -> Real:
    """State at the first sample: S^-1/2 U^T times the first column of H0."""
    column = decomposed.record[:, : decomposed.lags].T.reshape(-1)
    state: Real = (u.T @ column) / root
    return state


def _coherence(predicted: Complex, found: Complex) -> float:
    """Agreement of a mode's later lag with what its pole predicts, 0 to 1 (Pappa, Elliott and Schenk 1993)."""
    size = np.linalg.norm(predicted), np.linalg.norm(found)
    if min(size) == 0:
        return 0.0
    ratio = min(size) / max(size)
    phase = abs(np.angle(np.vdot(predicted, found)))
    return float(ratio * max(0.0, 1.0 - phase / (np.pi / 4)))


def _phase_collinearity(shapes: Complex) -> Real:
    """Modal phase collinearity of each column of ``shapes`` (c, m)."""
    x, y = shapes.real, shapes.imag
    sxx, syy, sxy = (x * x).sum(axis=0), (y * y).sum(axis=0), (x * y).sum(axis=0)
    total = np.where(sxx + syy > 0, sxx + syy, 1.0)
    mpc: Real = ((sxx - syy) ** 2 + 4 * sxy**2) / total**2
    return mpc if shapes.shape[0] > 1 else np.ones(shapes.shape[1])


def _pole_covariance(decomposed: HankelSvd, u: Real, root: Real, left: Complex, right: Complex, pole: complex) -> Real:
    """Covariance of log z for unit white noise: first-order perturbation of an eigenvalue of ERA.

    ``dz = p^T (dH1 - z dH0) q`` with ``p = U S^-1/2 l`` and ``q = V S^-1/2 r`` is linear in the noise samples;
    its weights are the convolution of p and q.
    """
    c = decomposed.record.shape[0]
    row = (u / root) @ left  # (lags c,)
    # V S^-1/2 r = H0^T U S^-3/2 r, a correlation of the record with the vector
    image = (u / root**3) @ right
    columns = np.zeros(decomposed.columns, np.complex128)
    for a in range(c):
        columns += np.correlate(decomposed.record[a, : decomposed.columns + decomposed.lags - 1], image[a::c].conj())
    variance, pseudo = 0.0, 0j
    for a in range(c):
        spread = np.convolve(row[a::c], columns)
        weights = np.concatenate(([0], spread)) - pole * np.concatenate((spread, [0]))
        weights = weights / pole  # d log z = dz / z
        variance += float((np.abs(weights) ** 2).sum())
        pseudo += complex((weights**2).sum())
    covariance = np.empty((2, 2))
    covariance[0, 0] = 0.5 * (variance + pseudo.real)
    covariance[1, 1] = 0.5 * (variance - pseudo.real)
    covariance[0, 1] = covariance[1, 0] = 0.5 * pseudo.imag
    return covariance
