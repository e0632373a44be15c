"""Where the residual is more than noise: frequency, time after the tap, load, channel; without any model of why."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma, norm

from analysis.mismatch.ring_downs.problem import RingDownFit

Real = NDArray[np.float64]

SURE = 1e-4  # p-value of a bin, all bins counted, from which on it holds more than noise
WINDOWS_S = (0.0, 0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3, 16e-3, 32e-3, 64e-3, 0.2)


@dataclass(frozen=True, slots=True)
class Excess:
    """Power of the residual over that of the noise, in bins.

    Attributes
    ----------
    edges
        (n + 1,) of the bins, Hz or s.
    power
        (channels, n) mean power over the noise's; the channels are the mean and the difference of A and B, or the
        channels themselves where there are not two.
    sure
        (channels, n) where it is more than noise.
    gain
        Chi-squared beyond the noise in these.
    """

    edges: Real
    power: Real
    sure: NDArray[np.bool_]
    p_value: float
    gain: float


def rotated(residual: Real) -> Real:
    """Return mean and difference (over sqrt 2) of two channels; other numbers of channels as they are."""
    if len(residual) != 2:
        return residual
    out: Real = np.stack([residual[0] + residual[1], residual[0] - residual[1]]) / math.sqrt(2)
    return out


def excess_by_frequency(fit: RingDownFit) -> Excess:
    """Return the residual's power in each frequency bin, all segments together."""
    n = min(r.shape[1] for r in fit.residuals)
    spectra = np.stack([np.abs(np.fft.rfft(rotated(r)[:, :n], axis=1)) ** 2 / n for r in fit.residuals])
    count = len(spectra)
    power = spectra.mean(axis=0)[:, 1:-1]
    tail = gamma.sf(power * count / (1 + fit.problem.experiment.level_error), count)
    tests = tail.size
    sure = tail * tests < SURE
    rate = fit.problem.experiment.sample_rate_hz
    edges = (np.arange(power.shape[1] + 1) + 0.5) * rate / n
    p = float(-math.expm1(tests * math.log1p(-min(float(tail.min()), 1 - 1e-12))))
    return Excess(edges, power, sure, p, float(np.sum((power[sure] - 1) * count)))


def excess_by_time(fit: RingDownFit) -> Excess:
    """Return the residual's power in windows after the tap, all segments together."""
    rate = fit.problem.experiment.sample_rate_hz
    edges = np.array(WINDOWS_S)
    channels = len(fit.residuals[0])
    energy, count = np.zeros((channels, edges.size - 1)), np.zeros(edges.size - 1)
    for residual in fit.residuals:
        window = np.searchsorted(edges, np.arange(residual.shape[1]) / rate, side="right") - 1
        for c, row in enumerate(rotated(residual)):
            energy[c] += np.bincount(window, row**2, minlength=edges.size - 1)[: edges.size - 1]
        count += np.bincount(window, minlength=edges.size - 1)[: edges.size - 1]
    used = count > 0
    energy, count = energy[:, used], count[used]
    edges = np.append(edges[:-1][used], edges[1:][used][-1])
    z = (energy - count) / np.sqrt(2 * count + (fit.problem.experiment.level_error * count) ** 2)
    tail = norm.sf(z)
    p = float(-math.expm1(tail.size * math.log1p(-min(float(tail.min()), 1 - 1e-12))))
    sure = tail * tail.size < SURE
    return Excess(edges, energy / count, sure, p, float(np.sum((energy - count)[sure])))


def excess_by_record(fit: RingDownFit) -> Real:
    """Return (segments,) in how many standard deviations each segment's residual is more than noise."""
    z = []
    for residual in fit.residuals:
        size = residual.size
        spread = math.sqrt(2 * size + (fit.problem.experiment.level_error * size) ** 2)
        z.append((float(np.vdot(residual, residual)) - size) / spread)
    return np.array(z)
