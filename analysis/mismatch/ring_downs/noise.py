"""The recorder's noise as white noise and a slow part: spectrum ``1 + b / (1 + (f / f_c)^2)``, and how to undo it.

The stretches before the trigger are too short to show the slow part, so its shape comes from the difference of two
channels that see the same motion, over whole segments. It is read from medians over bands: lines, which a channel's
gain or a turning mass would leave in the difference, do not move them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from sim_backend.arrays import Complex, Real

BANDS = 18
LOWEST_HZ = 15.0
SETTLING = 60  # samples in which the whitening forgets its start
LEVEL_BIAS = 0.005  # relative error of the level that no number of samples takes away
LEVEL_TRUST = 0.1  # difference of the two levels beyond which the difference holds more than noise
LEAST_DITHER = 0.3  # deviation of the noise over the recorder's step from which on rounding acts as white noise
MEDIAN = math.log(2.0)  # of a periodogram's value over its mean


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Noise that ``(1 - pole / z) / (1 - zero / z) / deviation`` makes white with unit variance."""

    pole: float
    zero: float
    deviation: float

    def whiten(self, y: Real) -> Real:
        """Whiten (..., n) that was zero before its first sample."""
        out: Real = lfilter([1.0, -self.pole], [1.0, -self.zero], y, axis=-1) / self.deviation
        return out

    def gain(self, s: Complex, sample_rate_hz: float) -> Complex:
        """Return by what a ring-down with poles s (1/s) is multiplied in whitening."""
        back = np.exp(-s / sample_rate_hz)
        return np.asarray((1 - self.pole * back) / (1 - self.zero * back) / self.deviation, np.complex128)

    def ringing(self, sample_rate_hz: float) -> float:
        """Pole of the whitening itself, 1/s, which what came before a segment leaves in it; NaN where it has none."""
        return math.log(self.zero) * sample_rate_hz if self.zero > 0 else math.nan


def noise_models(
    quiet: Sequence[Real], whole: Sequence[Real], sample_rate_hz: float, rounding: float = 0.0
) -> tuple[NoiseModel, ...]:
    """Return the noise of each channel.

    Parameters
    ----------
    quiet
        Records (c, n) before the trigger of each impact.
    whole
        (n,) stretches of noise as long as the segments, such as the difference of two channels; only the shape of
        their spectrum is used. Without any, the noise counts as white.
    rounding
        Step of the recorder, m/s2.

    Raises
    ------
    ValueError
        The noise is so small beside the step that rounding is no noise of its own.
    """
    audible = [w for w in whole if np.ptp(w) > 0]
    share, corner = _slow_part(audible, sample_rate_hz) if audible else (0.0, 1.0)
    pole = math.exp(-2 * math.pi * corner / sample_rate_hz)
    # slow part's variance over the white one's; `share` is its spectral density at zero over the white one's
    slow = share * (1 - pole) ** 2 / (1 - pole**2)
    total = 1 + pole**2 + slow * (1 - pole**2)
    zero = 2 * pole / (total + math.sqrt(max(total**2 - 4 * pole**2, 0.0)))
    shape = NoiseModel(pole, zero, 1.0)
    variance = np.mean([np.mean(_settled(shape, q) ** 2, axis=1) for q in quiet], axis=0)
    if not np.all(variance > (LEAST_DITHER * rounding) ** 2):
        raise ValueError(
            f"the noise of a channel is smaller than the recorder's step of {rounding:.3g} m/s2: rounding cannot be "
            "told from physics; a smaller range or a higher gain is needed"
        )
    if len(whole):
        of_difference = float(np.median(np.concatenate([_power(shape, w) for w in whole]))) / MEDIAN
        if abs(of_difference / variance.sum() - 1) < LEVEL_TRUST:
            variance = variance * (of_difference / variance.sum())  # the long stretches tell the level better
    return tuple(NoiseModel(pole, zero, math.sqrt(v)) for v in variance.tolist())


def level_error(samples: int) -> float:
    """Return the relative standard error of the noise's power from so many samples of a difference of channels."""
    return LEVEL_BIAS + math.sqrt(2.0 / samples) / MEDIAN


def _settled(shape: NoiseModel, y: Real) -> Real:
    """Whiten (..., n) and leave out what does not know its past."""
    n = y.shape[-1]
    return shape.whiten(y - y.mean(axis=-1, keepdims=True))[..., min(n // 4, SETTLING) :]


def _power(shape: NoiseModel, y: Real) -> Real:
    """Return the periodogram of a whitened stretch; its median is not moved by lines."""
    white = _settled(shape, y)
    out: Real = np.abs(np.fft.rfft(white)[1:-1]) ** 2 / white.size
    return out


def _slow_part(whole: Sequence[Real], sample_rate_hz: float) -> tuple[float, float]:
    """Density of the slow part at zero frequency over that of the white part, and its corner (Hz)."""
    n = min(w.size for w in whole)
    taper = np.hanning(n)
    spectra = np.stack([np.abs(np.fft.rfft((w[:n] - w[:n].mean()) * taper)) ** 2 for w in whole])
    frequency = np.fft.rfftfreq(n, 1 / sample_rate_hz)
    edges = np.geomspace(LOWEST_HZ, 0.45 * sample_rate_hz, BANDS + 1)
    middle, level, count = [], [], []
    for low, high in pairwise(edges):
        inside = (frequency >= low) & (frequency < high)
        if inside.any():
            middle.append(float(frequency[inside].mean()))
            level.append(math.log(float(np.median(spectra[:, inside])) / MEDIAN))
            count.append(math.sqrt(spectra.shape[0] * inside.sum()))
    f, y, w = np.array(middle), np.array(level), np.minimum(np.array(count), 60.0)

    def off(p: Real) -> Real:
        out: Real = w * (p[0] + np.log1p(np.exp(p[1]) / (1 + (f / np.exp(p[2])) ** 2)) - y)
        return out

    starts = [np.array([y[-1], math.log(share), math.log(corner)]) for share in (0.5, 5.0) for corner in (100.0, 800.0)]
    lower, upper = [-np.inf, math.log(1e-3), math.log(30.0)], [np.inf, math.log(1e4), math.log(0.2 * sample_rate_hz)]
    best = min(
        (least_squares(off, s, bounds=(lower, upper), loss="soft_l1") for s in starts), key=lambda found: found.cost
    )
    return math.exp(best.x[1]), math.exp(best.x[2])
