"""Sums over damped exponentials: all that a likelihood of them needs, in closed form or in one pass over the record.

Inner products of columns ``z^k`` are sums of ``k^p w^k``. The record enters through ``sum y_k w^k`` and
``sum k y_k w^k``; near a pole where they are known these sums are short power series (`Tail`), so that a record of any
length costs no more than its first samples.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

LARGEST_CANCELLATION = 1e7  # energy of all columns by themselves over that of the record
TERMS = 12  # of the power series of a tail
REMAINDER = 1e-4  # of the series, in standard deviations of the sum by the record's noise


@njit(cache=True)
def power_sums(w: complex, n: int) -> tuple[complex, complex, complex]:
    """Sum of w^k, k w^k and k^2 w^k over k = 0 ... n-1, by doubling: stable for any modulus near or below 1."""
    g0, g1, g2 = 0j, 0j, 0j  # sums over the first m terms
    m = 0
    power = 1.0 + 0j  # w^m
    top = 0
    while n >> (top + 1):
        top += 1
    for bit in range(top, -1, -1):
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
def data_sums(y: Real, z: complex) -> tuple[complex, complex]:
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
def all_poles(poles: Complex, fixed: Complex) -> Complex:
    """Moving poles, their conjugates, then the fixed ones."""
    j = poles.shape[0]
    out = np.empty(2 * j + fixed.shape[0], np.complex128)
    for a in range(j):
        out[a] = poles[a]
        out[j + a] = np.conj(poles[a])
    out[2 * j :] = fixed
    return out


@njit(cache=True)
def grams(z: Complex, n: int) -> tuple[Complex, Complex, Complex]:
    """Inner products of the columns z_a^k weighted with k^0, k^1, k^2."""
    p = z.shape[0]
    m0 = np.empty((p, p), np.complex128)
    m1 = np.empty((p, p), np.complex128)
    m2 = np.empty((p, p), np.complex128)
    for a in range(p):
        for b in range(a, p):
            s0, s1, s2 = power_sums(np.conj(z[a]) * z[b], n)
            m0[a, b], m1[a, b], m2[a, b] = s0, s1, s2
            m0[b, a], m1[b, a], m2[b, a] = np.conj(s0), np.conj(s1), np.conj(s2)
    return m0, m1, m2


@njit(cache=True)
def grams_without(z: Complex, n: int, missing: NDArray[np.int64]) -> tuple[Complex, Complex, Complex]:
    """As `grams`, over all samples but the missing ones."""
    m0, m1, m2 = grams(z, n)
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
def squares(y: Real) -> Real:
    """Sum of squares of each channel."""
    out = np.zeros(y.shape[0])
    for ch in range(y.shape[0]):
        for k in range(y.shape[1]):
            out[ch] += y[ch, k] * y[ch, k]
    return out


@njit(cache=True)
def normal_equations(
    m0: Complex, m1: Complex, m2: Complex, s0: Complex, s1: Complex, square: Real, weight: Real, moving: int
) -> tuple[float, Complex, Complex, Complex]:
    """Eliminate the amplitudes: weighted residual sum, amplitudes (c, p), and gradient and Hessian of the log poles.

    ``s0`` (c, p) and ``s1`` (c, moving) are the record's sums with the conjugate poles, ``square`` (c,) its sums of
    squares, ``weight`` (c,) inverse variances. The residual sum is infinite where columns nearly cancel and rounding
    would decide.
    """
    c, p = s0.shape
    inverse = np.linalg.inv(m0)
    schur = m2[:moving, :moving] - np.ascontiguousarray(m1[:moving, :]) @ inverse @ np.ascontiguousarray(m1[:, :moving])
    amplitudes = np.empty((c, p), np.complex128)
    gradient = np.zeros(moving, np.complex128)
    hessian = np.zeros((moving, moving), np.complex128)
    total = 0.0
    for ch in range(c):
        amp = inverse @ s0[ch]
        amplitudes[ch] = amp
        left, together = square[ch], 0.0
        for a in range(p):
            left -= 2.0 * (np.conj(amp[a]) * s0[ch, a]).real
            together += np.abs(amp[a]) ** 2 * m0[a, a].real
            for b in range(p):
                left += (np.conj(amp[a]) * m0[a, b] * amp[b]).real
        total += weight[ch] * (max(left, 0.0) if together < LARGEST_CANCELLATION * square[ch] else np.inf)
        slope = m1 @ amp
        for a in range(moving):
            gradient[a] += weight[ch] * np.conj(amp[a]) * (s1[ch, a] - slope[a])
            for b in range(moving):
                hessian[a, b] += weight[ch] * np.conj(amp[a]) * schur[a, b] * amp[b]
    return total, amplitudes, gradient, hessian


class Tail(NamedTuple):
    """The later part of a record, as power series about some poles.

    Attributes
    ----------
    samples
        How many it stands for.
    poles
        (J,) about which the series are.
    terms
        (c, J, TERMS): ``sum y_k k^p / p! conj(z)^k``.
    known
        (c, F) its sums with the known poles.
    square
        (c,) its sums of squares.
    reach
        (J,) changes of a log pole up to which the series are good.
    """

    samples: int
    poles: Complex
    terms: Complex
    known: Complex
    square: Real
    reach: Real


@njit(cache=True)
def no_tail(channels: int) -> Tail:
    """Of a record that is there as samples."""
    none = np.empty(0, np.complex128)
    empty = np.empty((channels, 0), np.complex128)
    return Tail(0, none, np.empty((channels, 0, 0), np.complex128), empty, np.zeros(channels), np.empty(0))


@njit(cache=True, fastmath={"contract", "reassoc"})
def _series(y: Real, z: complex) -> Complex:
    """``sum y_k k^p / p! z^k``, p = 0 ... TERMS - 1."""
    real, imag = np.zeros(TERMS), np.zeros(TERMS)
    inverse = 1.0 / np.maximum(np.arange(TERMS), 1)
    power = 1.0 + 0j
    for k in range(y.shape[0]):
        r, i = y[k] * power.real, y[k] * power.imag
        for p in range(TERMS):
            factor = k * inverse[p] if p > 0 else 1.0
            r *= factor
            i *= factor
            real[p] += r
            imag[p] += i
        power *= z
    return real + 1j * imag


@njit(cache=True)
def tail_of(y: Real, poles: Complex, known: Complex, variance: float) -> Tail:
    """Series of a record (c, n) about poles; ``variance`` is that of its noise, against which the remainder counts."""
    c, n = y.shape
    terms = np.empty((c, poles.shape[0], TERMS), np.complex128)
    sums = np.empty((c, known.shape[0]), np.complex128)
    reach = np.full(poles.shape[0], np.inf)
    last = TERMS - 1
    for ch in range(c):
        for a in range(known.shape[0]):
            sums[ch, a] = data_sums(y[ch], np.conj(known[a]))[0]
        for a in range(poles.shape[0]):
            terms[ch, a] = _series(y[ch], np.conj(poles[a]))
            g0, _, g2 = power_sums(complex(np.abs(poles[a]) ** 2, 0.0), n)
            size = np.abs(terms[ch, a, last]) + 1e-300
            value = REMAINDER * np.sqrt(variance * g0.real) / size
            slope = REMAINDER * np.sqrt(variance * g2.real) / (last * size)
            reach[a] = min(reach[a], value ** (1.0 / last), slope ** (1.0 / (last - 1)))
    return Tail(n, poles.copy(), terms, sums, squares(y), reach)


@njit(cache=True)
def record_sums(y: Real, tail: Tail, z: Complex, moving: int) -> tuple[bool, Complex, Complex]:
    """Sums (c, p) and (c, moving) of samples and a tail after them with the conjugates of all poles.

    False where a pole is out of the tail's reach.
    """
    c, h = y.shape
    p, half = z.shape[0], moving // 2
    s0 = np.empty((c, p), np.complex128)
    s1 = np.empty((c, moving), np.complex128)
    for a in range(half if tail.samples else 0):
        if not np.abs(np.log(z[a] / tail.poles[a])) < tail.reach[a]:
            return False, s0, s1
    for ch in range(c):
        for a in range(half):
            s0[ch, a], s1[ch, a] = data_sums(y[ch], np.conj(z[a]))
            if tail.samples:
                delta = np.log(np.conj(z[a] / tail.poles[a]))
                value, slope = 0j, 0j
                for q in range(TERMS - 1, -1, -1):
                    slope = slope * delta + value
                    value = value * delta + tail.terms[ch, a, q]
                shift = np.conj(z[a]) ** h
                s0[ch, a] += shift * value
                s1[ch, a] += shift * (slope + h * value)
            s0[ch, half + a], s1[ch, half + a] = np.conj(s0[ch, a]), np.conj(s1[ch, a])
        for a in range(moving, p):
            s0[ch, a] = data_sums(y[ch], np.conj(z[a]))[0]
            if tail.samples:
                s0[ch, a] += np.conj(z[a]) ** h * tail.known[ch, a - moving]
    return True, s0, s1


@njit(cache=True)
def normal_equations_of(
    y: Real, tail: Tail, square: Real, weight: Real, z: Complex, moving: int, missing: NDArray[np.int64]
) -> tuple[float, Complex, Complex, Complex]:
    """`normal_equations` of samples (c, h), zero at the ``missing`` ones, with a tail after them.

    ``square`` (c,) is the sum of squares of both. The residual sum is NaN where a pole is out of the tail's reach.
    """
    m0, m1, m2 = grams_without(z, y.shape[1] + tail.samples, missing)
    reached, s0, s1 = record_sums(y, tail, z, moving)
    if not reached:
        empty = np.zeros((moving, moving), np.complex128)
        return np.nan, s0, empty[0], empty
    return normal_equations(m0, m1, m2, s0, s1, square, weight, moving)
