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

from rig.errors import MesotapError

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

MAX_ITERATIONS = 60
CONVERGED = 1e-12  # relative fall of the sum of squares
SETTLED = 1e-4  # squared standard errors of the poles, by which a last step may still move them
ROUNDING = 1e-13  # of a record's energy: a fall of the sum of squares that rounding can feign
NONE_MISSING = np.zeros(0, np.int64)
LARGEST_CANCELLATION = 1e7  # energy of all columns by themselves over that of the record
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
def _power_sums(w: complex, n: int) -> tuple[complex, complex, complex]:
    """Sum of w^k, k w^k and k^2 w^k over k = 0 ... n-1, by doubling: stable for any modulus near or below 1."""
    g0, g1, g2 = 0j, 0j, 0j  # sums over the first m terms
    m = 0
    power = 1.0 + 0j  # w^m
    for bit in range(62, -1, -1):
        if m > 0:
            g2, g1, g0 = (
                g2 + power * (g2 + 2.0 * m * g1 + m * m * g0),
                g1 + power * (g1 + m * g0),
                g0 + power * g0,
            )
            m *= 2
            power *= power
        if (n >> bit) & 1:
            g0 += power
            g1 += m * power
            g2 += m * m * power
            m += 1
            power *= w
    return g0, g1, g2


@njit(cache=True, fastmath={"contract", "reassoc"})
def _data_sums(y: Real, z: complex) -> tuple[complex, complex]:
    """Sum of y_k z^k and of k y_k z^k, in four interleaved strands so that the processor can overlap them."""
    n = y.shape[0]
    zr, zi = z.real, z.imag
    z2 = z * z
    z4 = z2 * z2
    r4, i4 = z4.real, z4.imag
    pr = np.empty(4)
    pi = np.empty(4)
    p = 1.0 + 0j
    for j in range(4):
        pr[j], pi[j] = p.real, p.imag
        p *= z
    a0, b0, a1, b1 = 0.0, 0.0, 0.0, 0.0
    k = 0
    while k + 4 <= n:
        for j in range(4):
            v = y[k + j]
            vr, vi = v * pr[j], v * pi[j]
            a0 += vr
            b0 += vi
            a1 += (k + j) * vr
            b1 += (k + j) * vi
            t = pr[j] * r4 - pi[j] * i4
            pi[j] = pr[j] * i4 + pi[j] * r4
            pr[j] = t
        k += 4
    xr, xi = pr[0], pi[0]
    while k < n:
        v = y[k]
        a0 += v * xr
        b0 += v * xi
        a1 += k * v * xr
        b1 += k * v * xi
        t = xr * zr - xi * zi
        xi = xr * zi + xi * zr
        xr = t
        k += 1
    return complex(a0, b0), complex(a1, b1)


@njit(cache=True)
def _all_poles(poles: Complex, fixed: Complex) -> Complex:
    """Moving poles, their conjugates, then the fixed ones."""
    j = poles.shape[0]
    out = np.empty(2 * j + fixed.shape[0], np.complex128)
    for a in range(j):
        out[a] = poles[a]
        out[j + a] = np.conj(poles[a])
    out[2 * j :] = fixed
    return out


@njit(cache=True)
def _grams(z: Complex, n: int) -> tuple[Complex, Complex, Complex]:
    """Inner products of the columns z_a^k weighted with k^0, k^1, k^2."""
    p = z.shape[0]
    m0 = np.empty((p, p), np.complex128)
    m1 = np.empty((p, p), np.complex128)
    m2 = np.empty((p, p), np.complex128)
    for a in range(p):
        for b in range(a, p):
            s0, s1, s2 = _power_sums(np.conj(z[a]) * z[b], n)
            m0[a, b], m1[a, b], m2[a, b] = s0, s1, s2
            m0[b, a], m1[b, a], m2[b, a] = np.conj(s0), np.conj(s1), np.conj(s2)
    return m0, m1, m2


@njit(cache=True)
def _grams_without(z: Complex, n: int, missing: NDArray[np.int64]) -> tuple[Complex, Complex, Complex]:
    """As `_grams`, over all samples but the missing ones."""
    m0, m1, m2 = _grams(z, n)
    p = z.shape[0]
    column = np.empty(p, np.complex128)
    for k in missing:
        for a in range(p):
            column[a] = z[a] ** k
        for a in range(p):
            for b in range(p):
                inner = np.conj(column[a]) * column[b]
                m0[a, b] -= inner
                m1[a, b] -= k * inner
                m2[a, b] -= k * k * inner
    return m0, m1, m2


@njit(cache=True)
def _left_over(square: float, amplitudes: Complex, s0: Complex, m0: Complex) -> float:
    """Sum of squares that given amplitudes leave; infinite where columns nearly cancel and rounding would decide."""
    left, together = square, 0.0
    for a in range(amplitudes.shape[0]):
        left -= 2.0 * (np.conj(amplitudes[a]) * s0[a]).real
        together += np.abs(amplitudes[a]) ** 2 * m0[a, a].real
        for b in range(amplitudes.shape[0]):
            left += (np.conj(amplitudes[a]) * m0[a, b] * amplitudes[b]).real
    if not together < LARGEST_CANCELLATION * square:
        return np.inf
    return max(left, 0.0)


@njit(cache=True)
def _project(
    y: Real, weight: Real, z: Complex, moving: int, missing: NDArray[np.int64]
) -> tuple[float, Complex, Complex, Complex]:
    """Amplitudes for given poles, sum of squares, and the reduced normal equations of the log poles.

    ``y`` (c, n), zero at the ``missing`` samples; ``weight`` (c,) inverse variances, ``z`` all poles, the first
    ``moving`` of them searched for (conjugates included). Returns the weighted residual sum, amplitudes (c, p),
    gradient (moving,) and Hessian (moving, moving).
    """
    c, n = y.shape
    p = z.shape[0]
    m0, m1, m2 = _grams_without(z, n, missing)
    inverse = np.linalg.inv(m0)
    left = np.ascontiguousarray(m1[:moving, :])
    right = np.ascontiguousarray(m1[:, :moving])
    schur = m2[:moving, :moving] - left @ inverse @ right
    s0 = np.empty(p, np.complex128)
    s1 = np.empty(p, np.complex128)
    amplitudes = np.empty((c, p), np.complex128)
    gradient = np.zeros(moving, np.complex128)
    hessian = np.zeros((moving, moving), np.complex128)
    total = 0.0
    half = moving // 2
    for ch in range(c):
        for a in range(p):
            if half <= a < moving:
                s0[a], s1[a] = np.conj(s0[a - half]), np.conj(s1[a - half])
            else:
                s0[a], s1[a] = _data_sums(y[ch], np.conj(z[a]))
        amp = inverse @ s0
        amplitudes[ch] = amp
        square = 0.0
        for k in range(n):
            square += y[ch, k] * y[ch, k]
        total += weight[ch] * _left_over(square, amp, s0, m0)
        slope = m1 @ amp
        for a in range(moving):
            gradient[a] += weight[ch] * np.conj(amp[a]) * (s1[a] - slope[a])
            for b in range(moving):
                hessian[a, b] += weight[ch] * np.conj(amp[a]) * schur[a, b] * amp[b]
    return total, amplitudes, gradient, hessian


@njit(cache=True)
def _search(
    y: Real, weight: Real, start: Complex, fixed: Complex, missing: NDArray[np.int64], iterations: int
) -> tuple[bool, float, Complex, Complex, Complex]:
    """Levenberg-damped Gauss-Newton over the log poles. Returns whether it settled, and where.

    It has settled when a step moves the poles by a hundredth of their standard errors, or when what is left to gain
    is smaller than rounding.
    """
    j = start.shape[0]
    c, n = y.shape
    poles = start.copy()
    z = _all_poles(poles, fixed)
    total, amplitudes, gradient, hessian = _project(y, weight, z, 2 * j, missing)
    square = 0.0
    for ch in range(c):
        for k in range(n):
            square += weight[ch] * y[ch, k] * y[ch, k]
    damping = 0.0
    for _ in range(iterations):
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
            z = _all_poles(trial, fixed)
            new, amp, grad, hess = _project(y, weight, z, 2 * j, missing)
            if new <= total * (1.0 + 1e-14):
                fall = total - new
                poles, amplitudes, gradient, hessian = trial, amp, grad, hess
                total = new
                heavy = damping > 0.1  # a short step says nothing about how far the end is
                damping *= 0.1
                if damping < 1e-9:
                    damping = 0.0
                if total <= 0.0 or (not heavy and (fall <= CONVERGED * total or expected <= SETTLED * total / (c * n))):
                    return True, total, poles, amplitudes, hessian
                continue
            if damping > 1e-2 and np.abs(expected) < ROUNDING * square:
                return True, total, poles, amplitudes, hessian
        damping = 1e-3 if damping == 0.0 else 10.0 * damping
        if damping > 1e12:
            return True, total, poles, amplitudes, hessian  # no direction lowers the sum any more
    return False, total, poles, amplitudes, hessian


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
        converged, total, poles, amplitudes, hessian = _search(y, 1.0 / variance, start, known, missing, iterations)
        covariance = np.linalg.inv(hessian)
    except np.linalg.LinAlgError as singular:
        raise FitFailure("two of the exponentials cannot be told apart") from singular
    if not converged or not np.isfinite(total) or not np.isfinite(covariance).all():
        raise FitFailure("the search for the poles did not settle")
    scale = max(total, 0.0) / dof
    power = (np.diagonal(covariance)[:j]).real * scale
    pseudo = np.array([covariance[a, j + a] for a in range(j)]) * scale
    blocks = np.empty((j, 2, 2))
    blocks[:, 0, 0] = 0.5 * (power + pseudo.real)
    blocks[:, 1, 1] = 0.5 * (power - pseudo.real)
    blocks[:, 0, 1] = blocks[:, 1, 0] = 0.5 * pseudo.imag
    return ExponentialFit(
        poles=poles,
        amplitudes=amplitudes[:, :j].copy(),
        fixed_amplitudes=amplitudes[:, 2 * j :].real.copy(),
        noise_variance=variance * scale,
        log_pole_covariance=blocks,
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
    z = _all_poles(fit.poles, known)
    amplitude = np.concatenate([fit.amplitudes[0], fit.amplitudes[0].conj()])
    moving = amplitude.size
    m0, m1, m2 = _grams_without(z, n, missing)
    slope = m1[:, :moving] * amplitude[None, :]
    corner = amplitude.conj()[:, None] * m2[:moving, :moving] * amplitude[None, :]
    gram = np.block([[m0, slope], [slope.conj().T, corner]])
    scale = np.sqrt(np.maximum(np.diagonal(gram).real, 1e-300))
    inverse = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-13, hermitian=True) / np.outer(scale, scale)
    powers = z[None, :] ** k[:, None]
    columns = np.concatenate([powers, k[:, None] * powers[:, :moving] * amplitude[None, :]], axis=1)
    return exponentials(fit, k, known)[0], (columns @ inverse @ columns.conj().T).real
