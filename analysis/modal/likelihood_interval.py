"""By how much the interval of a faint mode is wider than the curvature of its likelihood says.

The standard error of a decay grows with the decay: an estimate that comes out too low states an error that is too small
as well. The likelihood knows better, it falls off more slowly to the other side. Where it falls by what 95 % allow, on
the farther side and for the last time, is the end of the interval; for a mode that stands far out of the noise both
ends are where the curvature puts them.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from analysis.modal.exponentials import NONE_MISSING, ExponentialFit
from analysis.modal.ring_down_model import Record
from analysis.modal.sums import all_poles, data_sums, grams_without, normal_equations, squares

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

REPEATS = 8  # stretches of equal energy over which the scatter of a fit's score is taken
FAINT = 2000.0  # energy of a mode over the noise's variance, above which its likelihood is that of a normal one
QUANTILE = 3.841458820694124  # of chi-squared with one degree of freedom, 95 %
# Over energy: share by which the logarithm's fall at 95 % is larger for a faint mode. Chosen on 75 loads of eight taps
# at 5 dB (benchmarks/harsh_taps.py, seeds 2027, 9931, 4711), where 91 % of the frequencies were inside without it.
CORRECTION = 10.0
WIDEST = 4.0  # times the interval of the curvature, at most
STEP = 0.25  # of it, by which the likelihood is looked at: beside its highest peak it may have others
FOLLOWING = np.array([0.0, -0.5, 0.5, -1.0, 1.0])  # half-widths by which the frequency may follow a decay
SCALES = np.array([1.0, 0.5, 0.7, 1.4, 2.0, 2.8])  # by which the decay may follow a frequency
HALVINGS = 4  # of the stretch in which an end lies


def energies(fit: ExponentialFit, samples: int) -> Real:
    """Energy of each mode over the variance of the noise."""
    rate = np.maximum(-2 * np.log(np.abs(fit.poles)), 1e-12)
    weight = 1.0 / np.maximum(fit.noise_variance, 1e-300)
    found: Real = 2 * (weight[:, None] * np.abs(fit.amplitudes) ** 2).sum(axis=0) * -np.expm1(-rate * samples) / rate
    return found


def widening(y: Real, fit: ExponentialFit, known: Complex, missing: NDArray[np.int64] = NONE_MISSING) -> Real:
    """Factors on the standard errors of real and imaginary part of each log pole.

    Parameters
    ----------
    y
        (c, n) record that was fitted, zero at the missing samples.
    fit
        Its fit.
    known
        Sampled poles of the further exponentials in the fit.
    missing
        Samples that were left out.

    Returns
    -------
    (J, 2) factors, 1 or more; 1 for every mode that is not faint.

    Examples
    --------
    >>> from analysis.modal.exponentials import fit_exponentials
    >>> k, z = np.arange(2000), 0.99 * np.exp(0.3j)
    >>> y = (z**k).real[None] + 1e-3 * np.random.default_rng(1).standard_normal((1, 2000))
    >>> widening(y, fit_exponentials(y, np.array([z])), np.zeros(0, complex))
    array([[1., 1.]])
    """
    factors = np.ones((fit.poles.size, 2))
    weight = 1.0 / np.maximum(fit.noise_variance, 1e-300)
    record = np.ascontiguousarray(y, dtype=np.float64)
    energy = energies(fit, y.shape[1])
    for m in np.flatnonzero(energy < FAINT):
        fall = QUANTILE * (1 + CORRECTION / max(float(energy[m]), CORRECTION))
        units = np.sqrt(QUANTILE * np.maximum(np.diagonal(fit.log_pole_covariance[m]), 1e-300))
        try:
            factors[m] = _widening(record, weight, fit.poles, known, missing, int(m), units, fall)
        except (np.linalg.LinAlgError, ZeroDivisionError):  # of what is no pole of the record
            continue
    return factors


def widened(covariance: Real, factors: Real) -> Real:
    """Covariance (2, 2) whose standard errors have grown by these factors."""
    return covariance * np.outer(factors, factors)


def spread_along(record: Record, fit: ExponentialFit) -> Real:
    """Factor by which the fit's covariances grow when the residual is not white: from stretches of the record.

    A mode whose frequency or damping changes along the ring-down leaves a residual that hangs together; the
    score of each stretch then scatters more than independent noise would make it.
    """
    n = record.y.shape[1]
    k = np.arange(n)
    columns = fit.poles[:, None] ** k[None, :]
    known = (fit.fixed_amplitudes @ record.known[:, None] ** k).real
    residual = record.y - 2.0 * (fit.amplitudes @ columns).real - known
    residual[:, record.missing] = 0.0
    weight = 1.0 / np.maximum(fit.noise_variance, 1e-300)
    factors = np.ones(fit.poles.size)
    for m in range(fit.poles.size):
        slope = k * columns[m]
        power = np.abs(slope) ** 2
        energy = np.concatenate([[0.0], np.cumsum(power)])
        edges = np.searchsorted(energy, np.linspace(0, energy[-1], REPEATS + 1)[1:-1])
        mixed = (weight[:, None] * residual * fit.amplitudes[:, m].conj()[:, None]).sum(axis=0) * slope.conj()
        score = np.array([part.sum() for part in np.split(mixed, edges)])
        expected = float((weight * np.abs(fit.amplitudes[:, m]) ** 2).sum() * power.sum())
        factors[m] = max(1.0, float((np.abs(score) ** 2).sum()) / max(expected, 1e-300))
    return factors


@njit(cache=True)
def _widening(
    y: Real, weight: Real, poles: Complex, known: Complex, missing: NDArray[np.int64], m: int, units: Real, fall: float
) -> Real:
    """Factors of one mode, all other poles as they are.

    ``units`` are the half-widths by curvature, ``fall`` that of twice the log-likelihood at the end of the interval.
    """
    z = all_poles(poles, known)
    c, p, half = y.shape[0], z.shape[0], poles.shape[0]
    s0 = np.empty((c, p), np.complex128)
    for ch in range(c):
        for a in range(p):
            s0[ch, a] = data_sums(y[ch], np.conj(z[a]))[0]
    square = squares(y)
    best = _left(y, weight, z, s0, square, missing, half, m, 0j)
    own = np.log(z[m])
    factors = np.ones(2)
    for part in range(2):
        direction = 1.0 + 0j if part == 0 else 1j
        # the other part may follow: at another frequency the decay may be another, too
        beside = 1j * units[1] * FOLLOWING if part == 0 else own.real * (SCALES - 1.0) + 0j
        small = 0.2 * units[part]
        near = 0.0
        for sign in (-1.0, 1.0):
            near += 0.5 * (_left(y, weight, z, s0, square, missing, half, m, sign * small * direction) - best)
        if not near > 0:
            continue
        limit = best + fall
        by_curvature = small * np.sqrt(QUANTILE / near)
        for sign in (-1.0, 1.0):
            low = 0.0
            for step in range(1, int(WIDEST / STEP) + 1):
                at = step * STEP * by_curvature
                if _least(y, weight, z, s0, square, missing, half, m, sign * at * direction, beside) < limit:
                    low = at
            high = low + STEP * by_curvature
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                if _least(y, weight, z, s0, square, missing, half, m, sign * middle * direction, beside) < limit:
                    low = middle
                else:
                    high = middle
            factors[part] = max(factors[part], high / by_curvature)
    return factors


@njit(cache=True)
def _least(
    y: Real,
    weight: Real,
    z: Complex,
    sums: Complex,
    square: Real,
    missing: NDArray[np.int64],
    half: int,
    m: int,
    change: complex,
    beside: Complex,
) -> float:
    """Least of what is left over some further changes."""
    least = np.inf
    for further in beside:
        least = min(least, _left(y, weight, z, sums, square, missing, half, m, change + further))
    return least


@njit(cache=True)
def _left(
    y: Real,
    weight: Real,
    z: Complex,
    sums: Complex,
    square: Real,
    missing: NDArray[np.int64],
    half: int,
    m: int,
    change: complex,
) -> float:
    """Weighted sum of squares that is left if one log pole is changed and only amplitudes follow."""
    poles, s0 = z.copy(), sums.copy()
    poles[m] = z[m] * np.exp(change)
    poles[half + m] = np.conj(poles[m])
    for ch in range(y.shape[0]):
        s0[ch, m] = data_sums(y[ch], np.conj(poles[m]))[0]
        s0[ch, half + m] = np.conj(s0[ch, m])
    m0, m1, m2 = grams_without(poles, y.shape[1], missing)
    return normal_equations(m0, m1, m2, s0, np.zeros((y.shape[0], 0), np.complex128), square, weight, 0)[0]
