"""Frequency and damping of a mode against its amplitude along the ring-down: what a linear mode keeps constant.

The record is cut into windows over which the mode falls by a fixed ratio; in each the mode's own pole is fitted
while those of the other modes stay and only their amplitudes are free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from analysis.modal.exponentials import FitFailure, fit_exponentials
from analysis.modal.modes import mode_from_sampled_pole
from analysis.statistics import combine
from calibration.estimate import Estimate

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

FALL = 1.6  # amplitude at the beginning of a window over that at its end
SHORTEST_PERIODS = 8  # of the mode in a window
LONGEST_SHARE = 0.25  # of the record in a window
LARGEST_ERROR = 0.25  # standard error of the damping ratio, relative, up to which a window says something
MOST_WINDOWS = 40
LARGEST_CHANGE = 0.1  # of the frequency: further off it is another mode
TINY = 1e-300  # below it a noise variance is that of a channel that is zero
FAINT = 100.0  # energy of the mode in a window over the noise's variance: less can be a line of the noise


@dataclass(frozen=True, slots=True)
class AmplitudePoint:
    """A mode in one window of a ring-down.

    Attributes
    ----------
    amplitude
        Of the channel that moves most, in the middle of the window, in the record's unit.
    time_s
        Middle of the window after the first sample.
    frequency_hz, damping_ratio
        Of the mode there.
    """

    amplitude: float
    time_s: float
    frequency_hz: Estimate
    damping_ratio: Estimate


def along_the_decay(
    y: Real, sample_rate_hz: float, poles: Complex, mode: int, known: Complex | None = None
) -> list[AmplitudePoint]:
    """Follow one mode along a free decay.

    Parameters
    ----------
    y
        (c, n) free decay.
    poles
        (J,) sampled poles of all modes in it.
    mode
        Which of them is followed.
    known
        Sampled poles of further exponentials in the record.

    Returns
    -------
    list of AmplitudePoint
        In time order; windows that say nothing about the damping are left out.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 1e4
    >>> y = np.exp(-20 * t) * np.sin(2 * np.pi * 300 * t) + 1e-4 * np.random.default_rng(1).standard_normal(t.size)
    >>> pole = np.exp(np.array([-20 + 2j * np.pi * 300]) / 1e4)
    >>> points = along_the_decay(y[None], 1e4, pole, mode=0)
    >>> bool(all(abs(p.frequency_hz.value - 300) < 5 for p in points))
    True
    """
    y = np.atleast_2d(np.asarray(y, np.float64))
    others = np.delete(poles, mode)
    fixed = np.concatenate([others, others.conj(), np.zeros(0) if known is None else known]).astype(np.complex128)
    pole = poles[mode : mode + 1].copy()
    decay, turn = -float(np.log(np.abs(pole[0]))), abs(float(np.angle(pole[0])))
    n = y.shape[1]
    length = int(np.log(FALL) / decay) if decay > 0 else n
    length = int(np.clip(length, SHORTEST_PERIODS * 2 * np.pi / max(turn, 1e-9), LONGEST_SHARE * n))
    points: list[AmplitudePoint] = []
    if length < 4 * (fixed.size + 2):
        return points
    for start in range(0, min(n - length + 1, MOST_WINDOWS * length), length):
        # an exponential that is over by now cannot be told from nothing
        alive = fixed[np.abs(fixed) ** start > 1e-6]
        try:
            fit = fit_exponentials(y[:, start : start + length], pole, alive)
        except FitFailure:
            continue
        found = mode_from_sampled_pole(
            complex(fit.poles[0]), fit.log_pole_covariance[0], fit.amplitudes[:, 0], sample_rate_hz
        )
        f, zeta = found.frequency_hz, found.damping_ratio
        lasts = (1 - abs(fit.poles[0]) ** (2 * length)) / max(1 - abs(fit.poles[0]) ** 2, 1e-9)
        power = np.abs(fit.amplitudes[:, 0]) ** 2
        # a record without noise has that of its own rounding
        noise = np.maximum(fit.noise_variance, max(np.finfo(float).eps ** 2 * float(power.max()), TINY))
        energy = 2 * float((power / noise).sum()) * lasts
        unsure = zeta.standard_error > LARGEST_ERROR * abs(zeta.value)
        if energy < FAINT or unsure or abs(f.value / _frequency(pole, sample_rate_hz) - 1) > LARGEST_CHANGE:
            if points:
                break  # the mode is over: what comes later is noise
            continue
        middle = abs(fit.poles[0]) ** (length / 2)
        amplitude = 2 * float(np.max(np.abs(fit.amplitudes[:, 0]))) * middle
        points.append(AmplitudePoint(amplitude, (start + length / 2) / sample_rate_hz, f, zeta))
    return points


def _frequency(pole: Complex, sample_rate_hz: float) -> float:
    return float(abs(np.log(pole[0]))) * sample_rate_hz / (2 * np.pi)


def combined_curve(curves: Sequence[Sequence[AmplitudePoint]]) -> list[AmplitudePoint]:
    """Join the curves of several impacts: points of like amplitude (within the fall of a window) become one."""
    points = sorted((p for curve in curves for p in curve), key=lambda p: -p.amplitude)
    joined: list[AmplitudePoint] = []
    while points:
        top = points[0].amplitude
        group = [p for p in points if p.amplitude > top / FALL]
        points = points[len(group) :]
        f = combine([p.frequency_hz.value for p in group], [p.frequency_hz.standard_error for p in group])
        zeta = combine([p.damping_ratio.value for p in group], [p.damping_ratio.standard_error for p in group])
        if f is not None and zeta is not None:
            amplitude = float(np.exp(np.mean(np.log([p.amplitude for p in group]))))
            joined.append(AmplitudePoint(amplitude, float(np.mean([p.time_s for p in group])), f, zeta))
    return joined


def varies(curves: Sequence[Sequence[AmplitudePoint]]) -> tuple[float, float]:
    """Probability that frequency, and damping, would differ as much along decays that keep them constant.

    Within each curve the points are held against their own mean, so that scatter from impact to impact does not count.

    Returns
    -------
    tuple
        p-values of frequency and damping ratio; 1 where there is nothing to compare.
    """
    answer = []
    for what in ("frequency_hz", "damping_ratio"):
        total, dof = 0.0, 0
        for curve in curves:
            values = np.array([getattr(p, what).value for p in curve])
            errors = np.array([getattr(p, what).standard_error for p in curve])
            if values.size < 2 or not (errors > 0).all():
                continue
            weights = 1 / errors**2
            mean = float(weights @ values / weights.sum())
            total += float(weights @ (values - mean) ** 2)
            dof += values.size - 1
        answer.append(float(stats.chi2.sf(total, dof)) if dof else 1.0)
    return answer[0], answer[1]
