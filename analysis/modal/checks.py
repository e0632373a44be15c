"""What a fit of two modes is held against: ERA of the same stretch, and the scores of the residual along it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import special

from analysis.modal.era import hankel_svd, realise
from analysis.modal.exponentials import ExponentialFit, FitFailure, subtracted
from analysis.modal.modes import ModeEstimate, mode_from_sampled_pole
from analysis.modal.pulse_end import ROUNDING
from analysis.modal.sums import power_sums

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

GROWN_CHANCE = 1e-4  # chance of a fit's scores, below which the residual is not noise and the interval grows
STRETCHES = 8  # of equal energy, of which each has a score
DISAGREEMENT = 5.0  # standard errors (of ERA) between ERA and maximum likelihood that are flagged
NUMERICAL = 1e-6  # relative difference of two methods that is theirs and not the data's
SPAN = 72  # samples of all lags of ERA beside maximum likelihood
WIDEST = 4  # samples from lag to lag
LARGEST_TURN = 2.0  # rad of the fastest mode from lag to lag


def era_modes(y: Real, fit: ExponentialFit, sample_rate_hz: float, thorough: bool) -> list[ModeEstimate] | None:
    """ERA of the same stretch; its order is the number of singular values above the noise's largest.

    If it is not to be thorough, lags are as far apart as the fastest mode of the fit allows.
    """
    turn = float(np.abs(np.angle(fit.poles[:2])).max())
    spacing = int(np.clip(LARGEST_TURN / max(turn, 1e-9), 1, WIDEST))
    lags = None if thorough or y.size < 4 * SPAN else SPAN // spacing
    try:
        decomposed = hankel_svd(y, lags, 1 if lags is None else spacing)
    except FitFailure:
        return None
    variance = float(fit.noise_variance[0])
    edge = np.sqrt(variance) * (np.sqrt(decomposed.lags) + np.sqrt(decomposed.columns))
    order = int(np.clip(np.count_nonzero(decomposed.singular_values > 1.02 * edge), 4, 12))
    for tried in (order, order + 1, order + 2, 4):
        realised = realise(decomposed, tried, variance)
        if realised.poles.size < 2:
            continue
        picked = [int(np.argmin(np.abs(np.log(realised.poles) - np.log(z)))) for z in fit.poles[:2]]
        # twice the same pole, or one far from where the likelihood puts it: not found at this order
        far = [
            abs(np.log(realised.poles[i] / z)) > 0.5 * abs(np.log(z))
            for i, z in zip(picked, fit.poles[:2], strict=True)
        ]
        if picked[0] != picked[1] and not any(far):
            return [
                mode_from_sampled_pole(
                    complex(realised.poles[i]), realised.log_pole_covariance[i], realised.shapes[:, i], sample_rate_hz
                )
                for i in picked
            ]
    return None


def disagreements(likely: Sequence[ModeEstimate], realised: Sequence[ModeEstimate]) -> list[str]:
    """Sentences where ERA and maximum likelihood differ beyond their uncertainties."""
    notes = []
    for name, a, b in zip(("system", "contact"), likely, realised, strict=True):
        for what, x, y in (
            ("frequency", a.frequency_hz, b.frequency_hz),
            ("damping", a.damping_ratio, b.damping_ratio),
        ):
            allowed = DISAGREEMENT * np.hypot(x.standard_error, y.standard_error) + NUMERICAL * abs(x.value)
            if abs(x.value - y.value) > allowed:
                notes.append(
                    f"ERA and maximum likelihood disagree on the {what} of the {name} mode: "
                    f"{y.value:.6g} and {x.value:.6g}"
                )
    return notes


def spread_of_scores(y: Real, fit: ExponentialFit, known: Complex) -> Real:
    """Factors (2,) by which the covariances of both modes grow: 1 where the residual can be white noise.

    The score of each stretch of equal energy is compared with what white noise makes of it.
    """
    none = np.zeros((1, 0))
    fixed = fit.fixed_amplitudes if known.size else none
    residual = subtracted(y[None], fit.amplitudes, fit.poles, fixed, known)[0]
    variance = float(fit.noise_variance[0])
    factors = np.ones(2)
    if not variance > ROUNDING * float(np.dot(y, y)) / y.size:
        return factors
    for m in range(2):
        ratio = _scatter(residual, complex(fit.poles[m]), STRETCHES) / variance
        if special.chdtrc(2 * STRETCHES, 2 * STRETCHES * ratio) < GROWN_CHANCE:
            factors[m] = ratio
    return factors


@njit(cache=True)
def _scatter(residual: Real, pole: complex, stretches: int) -> float:
    """Sum of the squared scores of stretches of equal energy over that energy: the variance of white noise."""
    n = residual.shape[0]
    decay = pole.real**2 + pole.imag**2
    total = power_sums(complex(decay, 0.0), n)[2].real
    power, size, energy, score, summed = 1.0 + 0j, 1.0, 0.0, 0j, 0.0
    edge = total / stretches
    for k in range(n):
        score += residual[k] * k * power
        energy += k * k * size
        power *= pole
        size *= decay
        if energy >= edge or k == n - 1:
            summed += score.real**2 + score.imag**2
            score = 0j
            edge += total / stretches
    return summed / total
