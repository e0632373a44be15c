"""Least squares with damped exponentials: the maximum-likelihood fit of a ring-down in white noise.

A ring-down of J modes, sampled at ``k = 0 ... n-1``, is ``y_k = sum_a c_a z_a^k`` over the poles z and their
conjugates. All inner products of such columns are sums of ``k^p w^k``, which have closed forms; the data enter
only through ``sum y_k z^k`` and ``sum k y_k z^k``. One pass over the record for each mode and iteration is all
that a Gauss-Newton step costs. The amplitudes are eliminated at every step (variable projection), so only
the poles are searched for. Real exponentials whose poles are known (the recorder's filter) may be added: their
amplitudes are fitted, their poles are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from analysis.modal.sums import Tail, all_poles, grams_without, no_tail, normal_equations_of, squares
from rig.errors import MesotapError

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

MAX_ITERATIONS = 60
CONVERGED = 1e-12  # relative fall of the sum of squares
SETTLED = 1e-4  # squared standard errors of the poles, by which a last step may still move them
ROUNDING = 1e-13  # of a record's energy: a fall of the sum of squares that rounding can feign
CANCELLED = 1e-16  # of a record's energy: a sum of squares that rounding leaves of nothing
RIDGE = 1e-13  # on a correlation matrix, below which columns are the same
NONE_MISSING = np.zeros(0, np.int64)
LARGEST_GROWTH = 1.02  # a sampled pole beyond this modulus cannot be a ring-down


class FitFailure(MesotapError, ValueError):
    """The data cannot carry the fit; the text is one sentence that says why."""


@dataclass(frozen=True, slots=True)
class ExponentialFit:
    """Poles and amplitudes of a ring-down with their covariance.

    Attributes
    ----------
    poles
        (J,) sampled poles z with positive imaginary part.
    amplitudes
        (c, J) complex amplitudes at the first sample: channel c holds ``2 Re(amplitude z^k)``.
    fixed_amplitudes
        (c, F) amplitudes of the exponentials with known poles.
    noise_variance
        (c,) residual variance of each channel, divided by its degrees of freedom.
    log_pole_covariance
        (J, 2, 2) covariance of real and imaginary part of ``log z``.
    residual_sum
        Residual sum of squares, each channel over its noise variance.
    dof
        Degrees of freedom of the noise estimate.
    """

    poles: Complex
    amplitudes: Complex
    fixed_amplitudes: Real
    noise_variance: Real
    log_pole_covariance: Real
    residual_sum: float
    dof: int


@njit(cache=True)
def search(
    y: Real, tail: Tail, weight: Real, start: Complex, fixed: Complex, missing: NDArray[np.int64], iterations: int
) -> tuple[bool, float, Complex, Complex, Complex]:
    """Levenberg-damped Gauss-Newton over the log poles of samples (c, h) with a tail after them.

    Returns whether it settled, the weighted residual sum, poles, amplitudes and Hessian. It has settled when a step
    moves the poles by a hundredth of their standard errors, or when what is left to gain is smaller than rounding;
    it has not where a pole leaves the tail's reach.
    """
    j = start.shape[0]
    samples = y.shape[0] * (y.shape[1] + tail.samples)
    poles = start.copy()
    each = squares(y) + tail.square
    square = (weight * each).sum()
    z = all_poles(poles, fixed)
    total, amplitudes, gradient, hessian = normal_equations_of(y, tail, each, weight, z, 2 * j, missing)
    damping = 0.0
    for _ in range(iterations):
        if np.isnan(total):
            break
        lhs = hessian.copy()
        for a in range(2 * j):
            lhs[a, a] = hessian[a, a] * (1.0 + damping) + 1e-300
        step = np.linalg.solve(lhs, gradient)
        expected = 0.0
        for a in range(2 * j):
            expected += (np.conj(step[a]) * gradient[a]).real
        trial = poles * np.exp(step[:j])
        good = True
        for a in range(j):
            if not np.isfinite(trial[a].real) or np.abs(trial[a]) > LARGEST_GROWTH or trial[a].imag <= 0:
                good = False
        if good:
            z = all_poles(trial, fixed)
            new, amp, grad, hess = normal_equations_of(y, tail, each, weight, z, 2 * j, missing)
            if np.isnan(new):
                break
            if new <= total * (1.0 + 1e-14):
                fall = total - new
                poles, amplitudes, gradient, hessian = trial, amp, grad, hess
                total = new
                heavy = damping > 0.1  # a short step says nothing about how far the end is
                damping *= 0.1
                if damping < 1e-9:
                    damping = 0.0
                if total <= 0.0 or (not heavy and (fall <= CONVERGED * total or expected <= SETTLED * total / samples)):
                    return True, total, poles, amplitudes, hessian
                continue
            if damping > 1e-2 and np.abs(expected) < ROUNDING * square:
                return True, total, poles, amplitudes, hessian
        damping = 1e-3 if damping == 0.0 else 10.0 * damping
        if damping > 1e12:
            return True, total, poles, amplitudes, hessian  # no direction lowers the sum any more
    return False, total, poles, amplitudes, hessian


@njit(cache=True)
def _estimated(
    y: Real, weight: Real, start: Complex, fixed: Complex, missing: NDArray[np.int64], iterations: int
) -> tuple[bool, float, Complex, Complex, Real]:
    """Search, and covariance (J, 2, 2) of the log poles in noise whose weighted variance is one."""
    settled, total, poles, amplitudes, hessian = search(
        y, no_tail(y.shape[0]), weight, start, fixed, missing, iterations
    )
    covariance = np.linalg.inv(hessian)
    j = poles.shape[0]
    blocks = np.empty((j, 2, 2))
    for a in range(j):
        power, pseudo = covariance[a, a].real, covariance[a, j + a]
        blocks[a, 0, 0] = 0.5 * (power + pseudo.real)
        blocks[a, 1, 1] = 0.5 * (power - pseudo.real)
        blocks[a, 0, 1] = blocks[a, 1, 0] = 0.5 * pseudo.imag
    settled = bool(settled and np.isfinite(total) and np.isfinite(blocks).all())
    return settled, total, poles, amplitudes, blocks


def fit_exponentials(
    y: Real,
    start: Complex,
    fixed: Complex | None = None,
    noise_variance: Real | None = None,
    iterations: int = MAX_ITERATIONS,
    missing: NDArray[np.int64] = NONE_MISSING,
) -> ExponentialFit:
    """Fit damped exponentials to a ring-down by least squares (maximum likelihood in white noise).

    Parameters
    ----------
    y
        (c, n) record of c channels that share the poles; amplitudes are free in each.
    start
        (J,) sampled poles ``exp(s dt)`` to start from, positive imaginary parts.
    fixed
        (F,) further poles (closed under conjugation) that are known; none by default.
    noise_variance
        (c,) relative noise variance of the channels (default: equal).
    iterations
        Steps after which the search is given up.
    missing
        Samples that are left out of all channels (a recorder that clips).

    Raises
    ------
    FitFailure
        If the record is too short or the normal equations are singular.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 1e4
    >>> y = np.exp(-20 * t) * np.sin(2 * np.pi * 300 * t)
    >>> start = np.exp(np.array([-30 + 2j * np.pi * 305]) / 1e4)
    >>> s = np.log(fit_exponentials(y[None], start).poles[0]) * 1e4
    >>> round(s.real, 3), round(s.imag / (2 * np.pi), 3)
    (np.float64(-20.0), np.float64(300.0))
    """
    y = np.ascontiguousarray(np.atleast_2d(y), dtype=np.float64)
    start = np.atleast_1d(np.asarray(start, np.complex128))
    known = np.zeros(0, np.complex128) if fixed is None else np.atleast_1d(np.asarray(fixed, np.complex128))
    c, n = y.shape
    j, f = start.size, known.size
    free = c * (2 * j + f) + 2 * j
    dof = c * (n - missing.size) - free
    if missing.size:
        y = y.copy()
        y[:, missing] = 0.0
    if dof < 8:
        raise FitFailure(f"{n} samples are too few for {j} modes")
    variance = np.ones(c) if noise_variance is None else np.asarray(noise_variance, np.float64)
    try:
        converged, total, poles, amplitudes, blocks = _estimated(y, 1.0 / variance, start, known, missing, iterations)
    except np.linalg.LinAlgError as singular:
        raise FitFailure("two of the exponentials cannot be told apart") from singular
    if not converged:
        raise FitFailure("the search for the poles did not settle")
    scale = max(float(total), CANCELLED * float(((y**2).sum(axis=1) / variance).sum()), 1e-300) / dof
    return ExponentialFit(
        poles=poles,
        amplitudes=amplitudes[:, :j].copy(),
        fixed_amplitudes=amplitudes[:, 2 * j :].real.copy(),
        noise_variance=variance * scale,
        log_pole_covariance=blocks * scale,
        residual_sum=float(total),
        dof=dof,
    )


@njit(cache=True)
def subtracted(y: Real, amplitudes: Complex, poles: Complex, fixed_amplitudes: Real, fixed: Complex) -> Real:
    """What exponentials leave of a record."""
    c, n = y.shape
    rest = y.copy()
    for a in range(poles.shape[0]):
        power = 1.0 + 0j
        for k in range(n):
            for ch in range(c):
                amp = amplitudes[ch, a]
                rest[ch, k] -= 2.0 * (amp.real * power.real - amp.imag * power.imag)
            power *= poles[a]
    for a in range(fixed.shape[0]):
        power = 1.0 + 0j
        for k in range(n):
            for ch in range(c):
                rest[ch, k] -= fixed_amplitudes[ch, a] * power.real
            power *= fixed[a]
    return rest


def exponentials(fit: ExponentialFit, k: NDArray[np.int64], fixed: Complex | None = None) -> Real:
    """Evaluate the fitted ring-down, (c, len(k)), at sample numbers ``k`` (negative ones extrapolate backwards)."""
    columns = np.exp(np.log(fit.poles)[:, None] * k)
    out: Real = 2.0 * (fit.amplitudes @ columns).real
    if fixed is not None and fixed.size:
        out = out + (fit.fixed_amplitudes @ np.exp(np.log(fixed)[:, None] * k)).real
    return out


def predict(
    fit: ExponentialFit,
    k: NDArray[np.int64],
    n: int,
    fixed: Complex | None = None,
    missing: NDArray[np.int64] = NONE_MISSING,
) -> tuple[Real, Real]:
    """Extrapolate a one-channel fit to samples ``k``, with the covariance of the extrapolation per unit noise variance.

    Parameters
    ----------
    fit
        Fit of one channel to ``n`` samples.
    k
        Sample numbers relative to the first one fitted, negative before it.
    fixed
        The known poles of the fit.
    missing
        Samples that the fit left out.

    Returns
    -------
    values, covariance
        (len(k),) and (len(k), len(k)).

    Examples
    --------
    >>> import numpy as np
    >>> k = np.arange(500)
    >>> y = 0.99**k * np.cos(0.2 * k)
    >>> fit = fit_exponentials(y[None], np.array([0.98 * np.exp(0.21j)]))
    >>> value, _ = predict(fit, np.array([-1]), k.size)
    >>> bool(np.isclose(value[0], 0.99**-1 * np.cos(0.2)))
    True
    """
    known = np.zeros(0, np.complex128) if fixed is None else fixed
    z = all_poles(fit.poles, known)
    amplitude = np.concatenate([fit.amplitudes[0], fit.amplitudes[0].conj(), fit.fixed_amplitudes[0, : known.size]])
    values, covariance = forecast(z, amplitude.astype(np.complex128), 2 * fit.poles.size, k, n, missing)
    return values, covariance


@njit(cache=True)
def forecast(
    z: Complex, amplitude: Complex, moving: int, k: NDArray[np.int64], n: int, missing: NDArray[np.int64]
) -> tuple[Real, Real]:
    """Values (m,) at samples ``k`` of exponentials fitted to ``n`` samples, and their covariance in unit noise."""
    p = z.shape[0]
    m0, m1, m2 = grams_without(z, n, missing)
    size = p + moving
    gram = np.empty((size, size), np.complex128)
    columns = np.empty((k.shape[0], size), np.complex128)
    for a in range(p):
        for b in range(p):
            gram[a, b] = m0[a, b]
        for i in range(k.shape[0]):
            columns[i, a] = z[a] ** k[i]
    for b in range(moving):
        for a in range(p):
            gram[a, p + b] = m1[a, b] * amplitude[b]
            gram[p + b, a] = np.conj(gram[a, p + b])
        for a in range(moving):
            gram[p + a, p + b] = np.conj(amplitude[a]) * m2[a, b] * amplitude[b]
        for i in range(k.shape[0]):
            columns[i, p + b] = k[i] * columns[i, b] * amplitude[b]
    values = np.zeros(k.shape[0])
    for i in range(k.shape[0]):
        for a in range(p):
            values[i] += (columns[i, a] * amplitude[a]).real
    scale = np.empty(size)
    for a in range(size):
        scale[a] = np.sqrt(max(gram[a, a].real, 1e-300))
    for a in range(size):
        for b in range(size):
            gram[a, b] /= scale[a] * scale[b]
        gram[a, a] += RIDGE
        for i in range(k.shape[0]):
            columns[i, a] /= scale[a]
    covariance = columns @ np.linalg.inv(gram) @ np.conj(columns).T
    return values, covariance.real
