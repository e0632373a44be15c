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
from analysis.modal.shapes import phase_collinearity
from analysis.modal.sums import power_sums

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]


LEAST_SHARE = 0.05  # of a squared singular value that is taken for signal, however large the noise


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
def _hankel_products(y: Real, lags: int, spacing: int, columns: int) -> tuple[Real, Real]:
    """``H0 H0^T`` and ``H1 H0^T``, (lags c, lags c): row i c + a is channel a at lag i."""
    c = y.shape[0]
    products = np.empty(((lags + 1) * c, lags * c))
    for a in range(c):
        for b in range(c):
            for i in range(lags + 1):
                inner = np.dot(y[a, i * spacing : i * spacing + columns], y[b, :columns])
                products[i * c + a, b] = inner
                if i < lags:
                    products[b, i * c + a] = inner
    for a in range(c):
        for b in range(c):
            for i in range(1, lags + 1):
                for j in range(1, lags):
                    # down a diagonal as many products enter and leave as lags are samples apart
                    gain = 0.0
                    for k in range((i - 1) * spacing, i * spacing):
                        m = k + (j - i) * spacing
                        gain += y[a, k + columns] * y[b, m + columns] - y[a, k] * y[b, m]
                    products[i * c + a, j * c + b] = products[(i - 1) * c + a, (j - 1) * c + b] + gain
    return products[: lags * c].copy(), products[c:].copy()


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
    spacing
        Samples between two lags.
    """

    vectors: Real
    singular_values: Real
    shifted: Real
    record: Real
    lags: int
    columns: int
    spacing: int = 1


def hankel_svd(y: Real, lags: int | None = None, spacing: int = 1) -> HankelSvd:
    """Return the singular vectors and values of the block Hankel matrix of one ring-down, or of several side by side.

    Parameters
    ----------
    y
        (c, n) ring-down, free decay only; or (m, c, n), m of them with the same modes.
    lags
        Block rows; by default a third of the record, at most 240 / sqrt(c).
    spacing
        Samples from one lag to the next. The fastest mode has to turn by less than half a turn in that time.

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
    columns = n - rows * spacing
    if rows < 4 or columns < rows:
        raise FitFailure(f"{n} samples are too few for the Eigensystem Realization Algorithm")
    g0, g1 = _hankel_products(several[0], rows, spacing, columns)
    for record in several[1:]:
        more0, more1 = _hankel_products(record, rows, spacing, columns)
        g0 += more0
        g1 += more1
    values, vectors = np.linalg.eigh(g0)
    singular = np.sqrt(np.clip(values[::-1], 0.0, None))
    if not singular[0] > 0:
        raise FitFailure("the record holds nothing but zeros")
    return HankelSvd(np.ascontiguousarray(vectors[:, ::-1]), singular, g1, several[0], rows, columns, spacing)


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
    c, spacing = decomposed.record.shape[0], decomposed.spacing
    u, s = decomposed.vectors[:, :order], decomposed.singular_values[:order]
    if order > s.size or s[-1] <= s[0] * 1e-13:
        order = int(np.count_nonzero(s > s[0] * 1e-13))
        u, s = u[:, :order], s[:order]
    column = np.ascontiguousarray(decomposed.record[:, : decomposed.lags * spacing : spacing].T.reshape(-1))
    poles, shapes, covariance, emac = _realised(
        np.ascontiguousarray(u), s, decomposed.shifted, column, decomposed.columns, spacing, c, noise_variance
    )
    return Realisation(
        poles=poles,
        shapes=shapes,
        log_pole_covariance=covariance,
        emac=emac,
        mpc=phase_collinearity(shapes),
        singular_values=decomposed.singular_values,
        order=order,
    )


@njit(cache=True)
def _realised(
    u: Real, singular: Real, shifted: Real, column: Real, columns: int, spacing: int, c: int, noise_variance: float
) -> tuple[Complex, Complex, Real, Real]:
    """Poles (m,), shapes (c, m), covariances (m, 2, 2) of the log poles, and EMAC (m,), ascending in frequency."""
    size = u.shape[0]
    # white noise adds its variance to the diagonal of H0 H0^T, and to the one above that of H1 H0^T
    added = noise_variance * columns
    s = np.sqrt(np.maximum(singular**2 - added, LEAST_SHARE * singular**2))
    root = np.sqrt(s)
    moved = u.T @ (shifted @ u) - added * (np.ascontiguousarray(u[: size - c]).T @ np.ascontiguousarray(u[c:]))
    values, right = np.linalg.eig((moved / np.outer(root, root * s)).astype(np.complex128))
    left = np.linalg.inv(right)  # rows: left eigenvectors with l r = 1
    complex_u = u.astype(np.complex128)
    observability = (complex_u * root) @ right  # (lags c, order)
    first_states: Complex = left @ ((u.T @ column) / root).astype(np.complex128)
    keep = np.flatnonzero((values.imag > 1e-9) & (np.abs(values) < 1.5))
    keep = keep[np.argsort(np.abs(np.angle(values[keep])))]
    of_a_sample: Complex = np.exp(np.log(values.astype(np.complex128)) / spacing)
    poles = of_a_sample[keep]
    shapes = np.empty((c, keep.size), np.complex128)
    covariance = np.zeros((keep.size, 2, 2))
    emac = np.empty(keep.size)
    lasting: Complex = of_a_sample / np.maximum(np.abs(of_a_sample), 1.0)
    lags = size // c
    for m in range(keep.size):
        own = keep[m]
        shapes[:, m] = observability[:c, own] * first_states[own]
        decay = -np.log(np.abs(values[own]))
        lag = lags - 1 if decay * (lags - 1) <= 1 else max(1, int(1 / decay))
        predicted = observability[:c, own] * values[own] ** lag
        emac[m] = _coherence(predicted, observability[lag * c : (lag + 1) * c, own])
        if noise_variance > 0:
            vector = np.ascontiguousarray(right[:, own])
            states = first_states * (np.ascontiguousarray(right.T) @ (vector / s))
            row = complex_u @ (np.ascontiguousarray(left[own]) / root)
            image = complex_u @ (vector / root**3)
            covariance[m] = noise_variance * _pole_covariance(
                row, image, values[own], states, lasting, columns, spacing, c, noise_variance
            )
    return poles, shapes, covariance, emac


@njit(cache=True)
def _coherence(predicted: Complex, found: Complex) -> float:
    """Agreement of a mode's later lag with what its pole predicts, 0 to 1 (Pappa, Elliott and Schenk 1993)."""
    first, second, inner = 0.0, 0.0, 0j
    for a in range(predicted.shape[0]):
        first += np.abs(predicted[a]) ** 2
        second += np.abs(found[a]) ** 2
        inner += np.conj(predicted[a]) * found[a]
    if min(first, second) == 0:
        return 0.0
    ratio = np.sqrt(min(first, second) / max(first, second))
    return ratio * max(0.0, 1.0 - abs(np.angle(inner)) / (np.pi / 4))


@njit(cache=True)
def _pole_covariance(
    row: Complex,
    image: Complex,
    pole: complex,
    states: Complex,
    poles: Complex,
    columns: int,
    spacing: int,
    c: int,
    variance: float,
) -> Real:
    """Covariance of log z for unit white noise: first-order perturbation of an eigenvalue of ERA.

    ``dz = p^T (dH1 - z dH0) q`` with ``p = U S^-1/2 l`` (``row``) and ``q = V S^-1/2 r = H0^T U S^-3/2 r`` is linear in
    the noise samples; its weights are the convolution of p and q. The realised system continues its own states, so that
    q is a sum of its ``poles``' powers with the amplitudes ``states``, and of the noise of this ``variance`` that
    ``image = U S^-3/2 r`` lets through.
    """
    size, pseudo = 0.0, 0j
    for a in range(c):
        # d log z = dz / z over the samples from lag to lag
        weights = np.zeros(spacing * (row.size // c) + 1, np.complex128)
        weights[:-1:spacing] -= row[a::c] / spacing
        weights[spacing::spacing] += row[a::c] / (spacing * pole)
        power, square = _convolved_squares(weights, states, poles, columns)
        size += power
        pseudo += square
        for b in range(c):
            backwards = np.zeros(weights.size, np.complex128)
            backwards[: weights.size - 1 : spacing] = image[b::c][::-1]
            noisy = np.convolve(weights, backwards)
            size += variance * columns * (noisy.real**2 + noisy.imag**2).sum()
            pseudo += variance * columns * (noisy**2).sum()
    covariance = np.empty((2, 2))
    covariance[0, 0] = 0.5 * (size + pseudo.real)
    covariance[1, 1] = 0.5 * (size - pseudo.real)
    covariance[0, 1] = covariance[1, 0] = 0.5 * pseudo.imag
    return covariance


@njit(cache=True)
def _convolved_squares(g: Complex, amplitudes: Complex, poles: Complex, n: int) -> tuple[float, complex]:
    """Sum of the squared moduli, and of the squares, of g convolved with the n samples of a sum of exponentials."""
    m, order = g.shape[0], poles.shape[0]
    head, end = np.zeros(m - 1, np.complex128), np.zeros(m - 1, np.complex128)
    inner = np.zeros(order, np.complex128)  # amplitudes of the convolution where g lies within the samples
    for b in range(order):
        power = 1.0 + 0j
        late = poles[b] ** (n - m + 1)
        for k in range(m - 1):
            head[k] += amplitudes[b] * power
            end[k] += amplitudes[b] * late * power
            inner[b] += g[m - 1 - k] * power
            power *= poles[b]
        inner[b] = amplitudes[b] * (inner[b] + g[0] * power)
    size, square = 0.0, 0j
    for t in range(m - 1):
        first, last = 0j, 0j
        for i in range(t + 1):
            first += g[i] * head[t - i]
            last += g[m - 1 - i] * end[m - 2 - t + i]
        for value in (first, last):
            size += value.real**2 + value.imag**2
            square += value * value
    for a in range(order):
        for b in range(order):
            size += (inner[a] * np.conj(inner[b]) * power_sums(poles[a] * np.conj(poles[b]), n - m + 1)[0]).real
            square += inner[a] * inner[b] * power_sums(poles[a] * poles[b], n - m + 1)[0]
    return size, square
