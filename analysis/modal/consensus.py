"""Which two poles the taps of a load have in common: the system mode, and the contact mode that all of them show."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

from analysis.modal.era import Realisation, hankel_svd, realise
from analysis.modal.exponentials import NONE_MISSING, ExponentialFit, FitFailure, fit_exponentials, subtracted
from analysis.modal.further import Decay
from analysis.modal.likelihood_interval import FAINT, energies
from analysis.modal.modes import sampled_pole
from analysis.modal.noise import NoiseModel
from analysis.modal.sums import all_poles, no_tail, normal_equations_of, squares

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

FEIGNED = 1e-3  # chance that noise alone passes for the contact mode of a load
CLEARLY = 3.0  # times what is enough, from which a look with the other mode as it is will do
SMALLEST_CHANCE = 1e-280  # that can be looked up
STRAY = 0.1  # share of its pole, by which the contact mode of a tap may differ from that of the others
PARAMETERS = 4  # of a mode in one tap
SHORT_LAGS = 60  # of the first realisation that is tried
HEAD = 200  # first samples of a decay
COMPLETE = 1.3  # their residual over the noise's variance, up to which the first poles that fit are the ones
HEAVY_DAMPING = (0.02, 0.05, 0.1, 0.18)  # what a spectral peak or a noisy realisation can miss
GRID_SAMPLES = 1000  # a heavily damped mode is over by then
CONTACT_MODE_ABOVE = 1.25  # the contact resonance lies at least this factor above the system resonance
HIGHEST_SHARE = 0.4  # of the sampling rate: no contact resonance is looked for above
LEAST_DAMPING_ERROR = 1e-3  # standard error of a damping ratio that is always good enough


def consensus(
    white: Sequence[Real],
    starts: Sequence[int],
    sample_rate_hz: float,
    expected_hz: float,
    known: Complex,
    noise: NoiseModel,
) -> tuple[Complex, dict[int, Decay]] | None:
    """Poles (system, contact) that fit all impacts of a load best, started from ERA and from a grid.

    The first that leave the strongest impacts nothing but their noise, from the first sample on, are taken.

    Parameters
    ----------
    white
        Whitened records.
    starts
        First sample of each that is surely after the pulse.
    expected_hz
        Where the system mode is looked for.
    known
        Sampled poles of the recorder's filter.

    Returns
    -------
    poles, decays
        The poles, and the fits of the strongest impacts by their number; None where no such poles are found.
    """
    rings = [i for i in range(len(white)) if starts[i] < white[i].size]  # the others end before their pulse does
    strongest = sorted(rings, key=lambda i: -float(np.std(white[i][starts[i] :])))[:3]
    best: tuple[float, Complex, dict[int, Decay]] | None = None
    for i in strongest:
        tail = white[i][starts[i] :]
        for candidate in _candidates(tail, expected_hz, sample_rate_hz, known, grid=i == strongest[0]):
            fit = fit_from(white[i], starts[i], candidate, known)
            if fit is None or not _plausible(fit.poles, expected_hz, sample_rate_hz):
                continue
            # the same poles must serve the other impacts, each with its own amplitudes
            total, served = 0.0, {}
            for j in strongest:
                other = fit if j == i else fit_from(white[j], starts[j], fit.poles, known)
                square = float(np.dot(white[j][starts[j] :], white[j][starts[j] :]))
                total += 1.0 if other is None else other.residual_sum / max(square, 1e-300)
                if other is not None:
                    served[j] = Decay(white[j], starts[j], other)
            if best is None or total < best[0] * (1 - 1e-9):
                best = total, fit.poles, served
            if len(served) == len(strongest) and _complete(served, noise, known):
                return fit.poles, served
    return None if best is None else best[1:]


def told_from_noise(late: dict[int, Decay], noise: NoiseModel, known: Complex) -> float:
    """How much each of both modes explains of all taps together, over what the best fit to noise would: the lesser.

    Each tap is fitted by itself, and each could have found the best line of its own noise. What counts is what the
    other mode alone would leave: of two modes that nearly cancel each may have any energy. Where the system mode
    explains nothing, a line of noise stands for it, and it for the contact mode.
    """
    if not late:
        return np.inf  # there is nothing to refuse
    places = len(late) * np.log(max(d.y.size for d in late.values()))
    chance = max(float(np.exp(np.log(FEIGNED) - places)), SMALLEST_CHANCE)
    enough = float(special.chdtri(PARAMETERS * len(late), chance))
    evidence = np.inf
    for mode in range(2):
        explained = sum(_explained(d, noise, known, mode, refit=False) for d in late.values())
        if explained < CLEARLY * enough:
            explained = sum(_explained(d, noise, known, mode, refit=True) for d in late.values())
        evidence = min(evidence, explained / enough)
    return evidence


def stands_out(decay: Decay, noise: NoiseModel, known: Complex) -> bool:
    """Whether the contact mode of one tap explains more than the best line of its noise would."""
    samples = decay.y.size - decay.start
    if energies(decay.fit, samples)[1] > FAINT:
        return True
    return _explained(decay, noise, known, 1, refit=True) > float(special.chdtri(PARAMETERS, FEIGNED / samples))


def _explained(decay: Decay, noise: NoiseModel, known: Complex, mode: int, refit: bool) -> float:
    """What a mode explains of one tap, in variances of the noise."""
    fit, y = decay.fit, decay.y[None, decay.start :]
    others = np.delete(fit.poles, mode)
    variance = float(fit.noise_variance[0])
    if noise.variance > 0:
        variance = max(variance, noise.variance)
    left = float(
        normal_equations_of(
            y, no_tail(1), squares(y), np.ones(1), all_poles(others, known), 2 * others.size, NONE_MISSING
        )[0]
    )
    if refit:
        with contextlib.suppress(FitFailure):
            left = min(left, fit_exponentials(y, others, known).residual_sum)
    return (left - fit.residual_sum) / max(variance, 1e-300)


def with_the_others(decays: dict[int, Decay], known: Complex) -> dict[int, Decay]:
    """Fit taps whose contact mode is faint anew, beginning where the others have it, and keep what leaves less.

    What a faint tap has found far from the others is a line of its noise, whatever it leaves.
    """
    if len(decays) < 3:
        return decays
    logs = np.array([np.log(d.fit.poles[1]) for d in decays.values()])
    middle = complex(np.median(logs.real), np.median(logs.imag))
    kept = dict(decays)
    for i, d in decays.items():
        if energies(d.fit, d.y.size - d.start)[1] > FAINT:
            continue
        stray = abs(np.log(d.fit.poles[1]) - middle) > STRAY * abs(middle)
        poles = d.fit.poles.copy()
        poles[1] = np.exp(middle)
        fit = fit_from(d.y, d.start, poles, known)
        if fit is None or abs(np.log(fit.poles[1]) - middle) > STRAY * abs(middle):
            continue
        if stray or fit.residual_sum < d.fit.residual_sum:
            kept[i] = Decay(d.y, d.start, fit)
    return kept


def fit_from(y: Real, start: int, poles: Complex, known: Complex) -> ExponentialFit | None:
    """Fit the modes of a record from a sample on, from these poles; None if that fails."""
    try:
        fit = fit_exponentials(y[start:], poles, known)
    except FitFailure:
        return None
    if abs(np.log(fit.poles[0])) <= abs(np.log(fit.poles[1])):
        return fit
    # system mode before contact mode; further ones keep their places
    order = np.append(np.argsort(np.abs(np.log(fit.poles[:2]))), np.arange(2, fit.poles.size))
    return ExponentialFit(
        fit.poles[order],
        fit.amplitudes[:, order],
        fit.fixed_amplitudes,
        fit.noise_variance,
        fit.log_pole_covariance[order],
        fit.residual_sum,
        fit.dof,
    )


def _complete(decays: dict[int, Decay], noise: NoiseModel, known: Complex) -> bool:
    """Whether two modes leave nothing but noise where a decay begins, and the contact mode stands out of it."""
    if not noise.variance > 0 or told_from_noise(decays, noise, known) <= 1:
        return False
    return all(
        d.y.size - d.start > HEAD and float(np.mean(_left(d, HEAD, known) ** 2)) < COMPLETE * noise.variance
        for d in decays.values()
    )


def _left(decay: Decay, samples: int, known: Complex) -> Real:
    """What the fit leaves of the first samples of a decay."""
    fit = decay.fit
    head = decay.y[None, decay.start : decay.start + samples]
    rest: Real = subtracted(head, fit.amplitudes, fit.poles, fit.fixed_amplitudes, known)[0]
    return rest


def _plausible(poles: Complex, expected_hz: float, sample_rate_hz: float) -> bool:
    """Whether a pair of poles can be the system and the contact mode."""
    s = np.log(poles) * sample_rate_hz
    f = np.abs(s) / (2 * np.pi)
    zeta = -s.real / np.abs(s)
    return bool(
        0.8 * expected_hz < f[0] < 1.2 * expected_hz
        and f[1] > CONTACT_MODE_ABOVE * f[0]
        and -0.02 < zeta[0] < 0.2
        and -LEAST_DAMPING_ERROR < zeta[1] < 0.6
    )


def _candidates(y: Real, expected_hz: float, sample_rate_hz: float, known: Complex, grid: bool) -> Iterator[Complex]:
    """Starting poles: the system mode at its spectral peak, the contact mode from ERA, the spectrum and a grid."""
    n = y.size
    padded = 2 ** int(np.ceil(np.log2(4 * n)))
    spectrum = np.abs(np.fft.rfft(y * np.cos(0.5 * np.pi * np.arange(n) / n) ** 2, padded))
    frequency = np.fft.rfftfreq(padded, 1 / sample_rate_hz)
    near = np.flatnonzero((frequency > 0.9 * expected_hz) & (frequency < 1.1 * expected_hz))
    above = np.flatnonzero(
        (frequency > CONTACT_MODE_ABOVE * expected_hz) & (frequency < HIGHEST_SHARE * sample_rate_hz)
    )
    if not near.size or not above.size:
        return  # the sampling rate leaves no room for these modes
    system = sampled_pole(float(frequency[near[np.argmax(spectrum[near])]]), 0.002, sample_rate_hz)
    highest = HIGHEST_SHARE * sample_rate_hz
    for lags in (SHORT_LAGS, None):
        try:
            decomposed = hankel_svd(y, lags)
        except FitFailure:
            continue
        for order in (4, 6, 10):
            for z in _contact_poles(realise(decomposed, order), expected_hz, sample_rate_hz):
                yield np.array([system, z])
    peak = float(frequency[above[np.argmax(spectrum[above])]])
    for zeta in (0.001, 0.005, 0.02):
        yield np.array([system, sampled_pole(peak, zeta, sample_rate_hz)])
    if grid:
        for z in _heavy_grid(y, system, expected_hz, highest, sample_rate_hz, known):
            yield np.array([system, z])


def _contact_poles(realised: Realisation, expected_hz: float, sample_rate_hz: float) -> list[complex]:
    """Return the strongest pole above the system mode, if there is one."""
    s = np.log(realised.poles) * sample_rate_hz
    f = np.abs(s) / (2 * np.pi)
    zeta = -s.real / np.abs(s)
    usable = np.flatnonzero(
        (f > CONTACT_MODE_ABOVE * expected_hz) & (f < HIGHEST_SHARE * sample_rate_hz) & (zeta > 0) & (zeta < 0.5)
    )
    if not usable.size:
        return []
    # energy of a mode: amplitude squared over decay
    energy = np.abs(realised.shapes[0, usable]) ** 2 / np.maximum(-s.real[usable], 1.0)
    return [complex(realised.poles[usable[np.argmax(energy)]])]


def _heavy_grid(
    y: Real, system: complex, expected_hz: float, highest_hz: float, sample_rate_hz: float, known: Complex
) -> list[complex]:
    """Best heavily damped second mode on a grid: least squares with both modes' amplitudes free."""
    length = min(y.size, GRID_SAMPLES)
    k = np.arange(length)
    frequencies = np.geomspace(CONTACT_MODE_ABOVE * expected_hz, highest_hz, 60)
    first = np.concatenate([(np.array([system])[:, None] ** k), (known[:, None] ** k)])
    base = np.concatenate([first.real, first[:1].imag])
    q, _ = np.linalg.qr(base.T)
    rest = y[:length] - q @ (q.T @ y[:length])
    best: tuple[float, complex] | None = None
    for zeta in HEAVY_DAMPING:
        for f in frequencies:
            z = sampled_pole(float(f), zeta, sample_rate_hz)
            column = z**k
            pair = np.stack([column.real, column.imag], axis=1)
            pair -= q @ (q.T @ pair)
            amplitude, *_ = np.linalg.lstsq(pair, rest, rcond=None)
            gain = float(rest @ (pair @ amplitude))
            if best is None or gain > best[0]:
                best = gain, z
    return [] if best is None else [best[1]]
