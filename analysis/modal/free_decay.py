"""Many ring-downs of one structure at once, each fitted by itself, in little more time than it takes to read them.

The likelihood of damped exponentials sees the data only through ``sum y_k z^k`` and ``sum k y_k z^k``. With the record
cut into blocks and one pole z0 near all the others, ``z = z0 exp(delta)``, those sums over a block are a short power
series in delta whose coefficients are the block's moments: one matrix product forms the moments of all records, and
every later step of the search works on them instead of the samples. The search begins with a realisation (ERA) of a
few lags and extends the fitted segment step by step, so that a coarse start does not skip a cycle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from analysis.modal.era import HankelSvd, hankel_svd, realise
from analysis.modal.exponentials import (
    CONVERGED,
    LARGEST_GROWTH,
    FitFailure,
    fit_exponentials,
)
from analysis.modal.modes import ModeEstimate, mode_from_sampled_pole
from analysis.modal.sums import all_poles, grams, normal_equations, squares

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

BLOCK = 40
TERMS = 6  # of the power series: relative error below 1e-8 within the reach
REACH = 0.35  # largest abs(delta) times half a block
SHORT_LAGS = 48
STRETCHES = (10, 40)  # blocks looked at before the whole record
STEPS = 25
# when a fit is taken as found: else other starts are tried, and the one that leaves least is kept
UNSURE = 0.05  # standard error of a pole over its size
SAME = 0.03  # of a pole's size, by which records of one structure may scatter
LARGEST_SCORE = 5.0
FAINT = 60.0  # energy of a mode over the noise's variance that the best fit to noise alone can reach


@dataclass(frozen=True, slots=True)
class FreeDecays:
    """Poles of m ring-downs in c channels.

    Attributes
    ----------
    poles
        (m, J) sampled poles, ascending in frequency.
    log_pole_covariance
        (m, J, 2, 2) covariance of real and imaginary part of ``log z``, white noise.
    amplitudes
        (m, c, J) complex amplitudes at the first sample; a channel holds ``2 Re(amplitude z^k)``.
    noise_variance
        (m,) residual variance over its degrees of freedom.
    sample_rate_hz
        Sampling rate.
    """

    poles: Complex
    log_pole_covariance: Real
    amplitudes: Complex
    noise_variance: Real
    sample_rate_hz: float

    def modes(self, record: int) -> list[ModeEstimate]:
        """Modes of one of the ring-downs with their uncertainties."""
        return [
            mode_from_sampled_pole(
                complex(self.poles[record, j]),
                self.log_pole_covariance[record, j],
                self.amplitudes[record, :, j],
                self.sample_rate_hz,
            )
            for j in range(self.poles.shape[1])
        ]


def identify_free_decays(y: Real, sample_rate_hz: float, modes: int = 2, known: Complex | None = None) -> FreeDecays:
    """Find the modes of several free decays of one structure, each by itself, by maximum likelihood in white noise.

    Parameters
    ----------
    y
        (m, c, n) m records of c channels; (c, n) is one record of c channels. White noise and no pulse: a free decay.
    sample_rate_hz
        Samples a second.
    modes
        How many there are.
    known
        Sampled poles of further exponentials that are known (a recorder's filter), closed under conjugation.

    Returns
    -------
    FreeDecays
        (m, modes) poles with their covariances.

    Raises
    ------
    FitFailure
        If the records are too short or hold no such modes.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 1e4
    >>> y = np.exp(-20 * t) * np.sin(2 * np.pi * 300 * t)
    >>> y += 0.5 * np.exp(-60 * t) * np.sin(2 * np.pi * 900 * t)
    >>> y += 1e-4 * np.random.default_rng(1).standard_normal(t.size)
    >>> found = identify_free_decays(y[None], 1e4)
    >>> np.round(np.abs(np.log(found.poles[0])) * 1e4 / (2 * np.pi))
    array([300., 900.])
    """
    y = np.asarray(y, np.float64)
    if y.ndim == 2:
        y = y[None]
    if y.ndim != 3 or y.shape[2] < 8 * modes + 16:
        raise FitFailure(f"free decays of shape {y.shape} are too short for {modes} modes: (m, c, n) is expected")
    fixed = np.zeros(0, np.complex128) if known is None else np.asarray(known, np.complex128)
    best: tuple[float, FreeDecays] | None = None
    for start in _starts(y, modes):
        try:
            found = fit_free_decays(y, start, sample_rate_hz, fixed)
        except (FitFailure, np.linalg.LinAlgError):
            continue
        left = float(found.noise_variance.sum())
        if best is None or left < best[0]:
            best = left, found
        if _settled(best[1]):
            break
    if best is None:
        raise FitFailure(f"the records do not hold {modes} modes that can be told from their noise")
    return best[1] if _settled(best[1]) else _rescued(y, best[1], fixed)


def _rescued(y: Real, found: FreeDecays, known: Complex) -> FreeDecays:
    """Fit records that stand apart again from where the others are, and keep what leaves less."""
    poles, spread = found.poles.copy(), found.log_pole_covariance.copy()
    amplitudes, noise = found.amplitudes.copy(), found.noise_variance.copy()
    centre = np.median(np.log(poles).real, axis=0) + 1j * np.median(np.log(poles).imag, axis=0)
    apart = (np.abs(np.log(poles) - centre) > SAME * np.abs(centre)).any(axis=1)
    for i in np.flatnonzero(apart):
        try:
            fit = fit_exponentials(y[i], np.exp(centre), known)
        except FitFailure:
            continue
        variance = float(fit.noise_variance[0])
        if variance <= noise[i] * (1 + 1e-9):
            order = np.argsort(np.abs(np.log(fit.poles)))
            poles[i], spread[i] = fit.poles[order], fit.log_pole_covariance[order]
            amplitudes[i], noise[i] = fit.amplitudes[:, order], variance
    return FreeDecays(poles, spread, amplitudes, noise, found.sample_rate_hz)


def _settled(found: FreeDecays) -> bool:
    """Whether every mode stands out of the noise, is well determined, and the records agree on it."""
    lasts = 1 / np.maximum(1 - np.abs(found.poles) ** 2, 1e-6)
    energy = 2 * (np.abs(found.amplitudes) ** 2).sum(axis=1) * lasts
    if (energy < FAINT * found.noise_variance[:, None]).any():
        return False
    size = np.abs(np.log(found.poles))
    error = np.sqrt(np.trace(found.log_pole_covariance, axis1=2, axis2=3))
    middle = np.median(found.poles, axis=0)
    apart = np.abs(found.poles - middle)
    return bool(
        (error < UNSURE * size).all() and (apart < LARGEST_SCORE * error + SAME * size).all() and (size < np.pi).all()
    )


def fit_free_decays(y: Real, start: Complex, sample_rate_hz: float, known: Complex) -> FreeDecays:
    """Fit every record from the same starting poles; see `identify_free_decays`."""
    m, c, n = y.shape
    j = start.size
    dof = c * n - c * (2 * j + known.size) - 2 * j
    if dof < 8:
        raise FitFailure(f"{n} samples are too few for {j} modes")
    poles = np.empty((m, j), np.complex128)
    amplitudes = np.empty((m, c, j), np.complex128)
    covariance = np.empty((m, 2 * j, 2 * j), np.complex128)
    residual = np.empty(m)
    good = np.zeros(m, np.bool_)
    blocks = -(-n // BLOCK)
    padded = np.zeros((m * c, blocks * BLOCK))
    padded[:, :n] = y.reshape(m * c, n)
    reference = start
    left = np.arange(m)
    for _ in range(3):  # a record whose poles lie out of the series' reach is done again about its own
        tables = _tables(reference, known)
        moments = (padded.reshape(m * c * blocks, BLOCK) @ tables).reshape(m, c, blocks, tables.shape[1])
        _fit_all(
            left, moments, padded.reshape(m, c, -1), n, reference, known, poles, amplitudes, covariance, residual, good
        )
        left = np.flatnonzero(~good)
        if left.size == 0:
            break
        usable = np.isfinite(poles[left[0]]).all() and (np.abs(np.log(poles[left[0]] / reference)) > 1e-9).any()
        if not usable:
            break
        reference = poles[left[0]].copy()
    for i in left:
        fit = fit_exponentials(y[i], start, known)
        poles[i], amplitudes[i] = fit.poles, fit.amplitudes
        residual[i] = fit.residual_sum
        covariance[i] = np.nan
    scale = residual / dof
    order = np.argsort(np.abs(np.log(poles)), axis=1)
    rows = np.arange(m)[:, None]
    power = covariance[:, np.arange(j), np.arange(j)].real * scale[:, None]
    pseudo = covariance[:, np.arange(j), j + np.arange(j)] * scale[:, None]
    spread = np.empty((m, j, 2, 2))
    spread[..., 0, 0] = 0.5 * (power + pseudo.real)
    spread[..., 1, 1] = 0.5 * (power - pseudo.real)
    spread[..., 0, 1] = spread[..., 1, 0] = 0.5 * pseudo.imag
    for i in left:
        spread[i] = fit_exponentials(y[i], poles[i], known).log_pole_covariance
    return FreeDecays(
        poles=poles[rows, order],
        log_pole_covariance=spread[rows, order],
        amplitudes=np.take_along_axis(amplitudes, order[:, None, :], axis=2),
        noise_variance=scale,
        sample_rate_hz=sample_rate_hz,
    )


def _starts(y: Real, modes: int) -> Iterator[Complex]:
    """Poles of a short realisation of the strongest channel; then of longer ones of all records together."""
    energy = np.einsum("mcn,mcn->mc", y, y)
    record, channel = np.unravel_index(int(np.argmax(energy)), energy.shape)
    poles = _strongest(hankel_svd(y[record, channel], min(SHORT_LAGS, y.shape[2] // 3)), modes)
    if poles is not None:
        yield poles
    for lags in (SHORT_LAGS, 2 * SHORT_LAGS, 5 * SHORT_LAGS):
        if y.shape[2] < 3 * lags:
            break
        for stretch in (min(y.shape[2], 8 * lags), y.shape[2]):
            together = hankel_svd(y[:, channel : channel + 1, :stretch], lags)
            poles = _strongest(together, modes)
            if poles is not None:
                yield poles


def _strongest(decomposed: HankelSvd, modes: int) -> Complex | None:
    """The strongest oscillating poles of a realisation, from the lowest order that has enough of them."""
    for order in (2 * modes, 2 * modes + 2, 2 * modes + 4):
        realised = realise(decomposed, order)
        decaying = np.flatnonzero(np.abs(realised.poles) < 1.001)
        if decaying.size >= modes:
            strength = np.abs(realised.shapes[0, decaying])
            picked = decaying[np.argsort(-strength)[:modes]]
            poles = realised.poles[picked]
            return poles / np.maximum(1.0, np.abs(poles) / 0.9999)
    return None


def _tables(reference: Complex, known: Complex) -> Real:
    """Columns (BLOCK, 2 (J TERMS + F)) whose products with a block are its moments about each pole's conjugate."""
    j = np.arange(BLOCK)
    centred = j - 0.5 * (BLOCK - 1)
    columns = []
    for z in reference:
        column = np.conj(z) ** j
        for _p in range(TERMS):
            columns.append(column)
            column = column * centred / (_p + 1)
    columns += [np.conj(z) ** j for z in known]
    stacked = np.array(columns).T
    return np.ascontiguousarray(stacked).view(np.float64)


@njit(cache=True)
def _sums(moments: Real, place: int, reference: complex, delta: complex, blocks: int) -> tuple[complex, complex]:
    """Sum of y_k w^k and k y_k w^k over the first blocks, w = conj(reference) exp(delta), from the moments."""
    half = 0.5 * (BLOCK - 1)
    step = np.conj(reference) ** BLOCK * np.exp(delta * BLOCK)
    factor = np.exp(delta * half)
    s0, s1 = 0j, 0j
    for b in range(blocks):
        row = moments[b]
        inner, slope = 0j, 0j
        for p in range(TERMS - 1, -1, -1):
            slope = slope * delta + inner
            inner = inner * delta + complex(row[place + 2 * p], row[place + 2 * p + 1])
        s0 += factor * inner
        s1 += factor * ((b * BLOCK + half) * inner + slope)
        factor *= step
    return s0, s1


@njit(cache=True)
def _known_sum(moments: Real, place: int, z: complex, blocks: int) -> complex:
    step = np.conj(z) ** BLOCK
    factor, total = 1.0 + 0j, 0j
    for b in range(blocks):
        total += factor * complex(moments[b, place], moments[b, place + 1])
        factor *= step
    return total


@njit(cache=True)
def _project(
    moments: Real, square: Real, reference: Complex, poles: Complex, known: Complex, blocks: int, n: int
) -> tuple[float, Complex, Complex, Complex]:
    """Normal equations of one record (c, blocks, K), from its moments."""
    c = moments.shape[0]
    j, f = reference.shape[0], known.shape[0]
    moving = 2 * j
    s0 = np.empty((c, moving + f), np.complex128)
    s1 = np.empty((c, moving), np.complex128)
    for ch in range(c):
        for a in range(j):
            delta = np.log(np.conj(poles[a] / reference[a]))
            s0[ch, a], s1[ch, a] = _sums(moments[ch], 2 * TERMS * a, reference[a], delta, blocks)
            s0[ch, j + a], s1[ch, j + a] = np.conj(s0[ch, a]), np.conj(s1[ch, a])
        for a in range(f):
            s0[ch, moving + a] = _known_sum(moments[ch], 2 * (TERMS * j + a), known[a], blocks)
    m0, m1, m2 = grams(all_poles(poles, known), n)
    return normal_equations(m0, m1, m2, s0, s1, square, np.ones(c), moving)


@njit(cache=True)
def _search(
    moments: Real, square: Real, reference: Complex, start: Complex, known: Complex, blocks: int, n: int
) -> tuple[bool, float, Complex, Complex, Complex]:
    """Levenberg-damped Gauss-Newton on the moments of one record; gives up where the series does not reach."""
    j = start.shape[0]
    poles = start.copy()
    total, amplitudes, gradient, hessian = _project(moments, square, reference, poles, known, blocks, n)
    damping = 0.0
    fenced = False  # whether the reach of the series, not the data, turned a step down
    for _ in range(STEPS):
        lhs = hessian.copy()
        for a in range(2 * j):
            lhs[a, a] = hessian[a, a] * (1.0 + damping) + 1e-300
        step = np.linalg.solve(lhs, gradient)
        trial = poles * np.exp(step[:j])
        within = True
        for a in range(j):
            away = np.abs(np.log(trial[a] / reference[a])) * 0.5 * BLOCK
            if (
                not np.isfinite(trial[a].real)
                or away > REACH
                or np.abs(trial[a]) > LARGEST_GROWTH
                or trial[a].imag <= 0
            ):
                within = False
        fenced = fenced or not within
        if within:
            new, amp, grad, hess = _project(moments, square, reference, trial, known, blocks, n)
            # what rounding can do to a sum of squares of this size is not a rise
            if new <= total + 1e-13 * square.sum():
                fall = total - new
                # the search ends with a step of a hundredth of a standard error
                expected = 0.0
                for a in range(2 * j):
                    expected += (np.conj(step[a]) * gradient[a]).real
                poles, amplitudes, gradient, hessian = trial, amp, grad, hess
                total = new
                damping = 0.0 if damping < 1e-8 else 0.1 * damping
                fenced = fenced and damping > 0.0
                if fenced:
                    continue
                if fall <= CONVERGED * total or expected <= 1e-4 * total / n:
                    return True, total, poles, amplitudes, hessian
                continue
        if damping > 1e10:
            return not fenced, total, poles, amplitudes, hessian
        damping = 1e-3 if damping == 0.0 else 10.0 * damping
    return False, total, poles, amplitudes, hessian


@njit(cache=True)
def _fit_all(
    wanted: NDArray[np.int64],
    moments: Real,
    y: Real,
    n: int,
    reference: Complex,
    known: Complex,
    poles: Complex,
    amplitudes: Complex,
    covariance: Complex,
    residual: Real,
    good: NDArray[np.bool_],
) -> None:
    """Fit the wanted records, each over growing stretches; results are written in place."""
    j = reference.shape[0]
    blocks = moments.shape[2]
    last = reference.copy()
    for i in wanted:
        begin = last.copy()
        if i == wanted[0]:
            for stretch in STRETCHES:
                if stretch < blocks:
                    length = stretch * BLOCK
                    square = squares(y[i][:, :length])
                    ok, _, found, _, _ = _search(moments[i], square, reference, begin, known, stretch, length)
                    if ok:
                        begin = found
        square = squares(y[i][:, :n])
        ok, total, found, amp, hessian = _search(moments[i], square, reference, begin, known, blocks, n)
        poles[i], residual[i], good[i] = found, total, ok
        for ch in range(amp.shape[0]):
            for a in range(j):
                amplitudes[i, ch, a] = amp[ch, a]
        covariance[i] = np.linalg.inv(hessian)
        if ok:
            last = found
