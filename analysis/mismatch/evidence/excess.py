"""Where the residual is more than noise, without any model of why: by frequency, time after the tap, load, impact."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma, norm

from analysis.mismatch.chi_squared import p_of
from analysis.mismatch.ring_downs.problem import RingDownFit
from sim_backend.arrays import Real

SURE = 1e-4  # p-value of a bin, all bins counted, from which on it holds more than noise
WINDOWS_S = (0.0, 0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3, 16e-3, 32e-3, 64e-3, 0.2)
BANDS = 28  # of a map
LOWEST_HZ = 100.0

Powers = Callable[[Real], tuple[Real, Real]]
"""Of a row (n,) of a residual: powers over the noise's, and at which frequency or time each is."""


@dataclass(frozen=True, slots=True)
class Excess:
    """Power of the residual over that of the noise, in bins, all segments together.

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


@dataclass(frozen=True, slots=True)
class ExcessMap:
    """The same at each load, (channels, loads, bins); NaN where there are no samples; ``loads_n`` ascending."""

    loads_n: tuple[float, ...]
    edges: Real
    power: Real


@dataclass(frozen=True, slots=True)
class Impacts:
    """One number an impact, each (impacts,): place in the session, load (N), largest dynamic contact force over the
    load, and by how many standard deviations the residual is more than noise."""

    order: Real
    load_n: Real
    force_ratio: Real
    excess: Real


def excess_by_frequency(fit: RingDownFit) -> Excess:
    """Return the residual's power at each frequency that the shortest segment resolves."""
    n = min(r.shape[1] for r in fit.residuals)
    spectra = np.stack([np.abs(np.fft.rfft(rotated(r)[:, :n], axis=1)) ** 2 / n for r in fit.residuals])
    count = len(spectra)
    power = spectra.mean(axis=0)[:, 1:-1]
    tail = gamma.sf(power * count / (1 + fit.problem.experiment.level_error), count)
    edges = (np.arange(power.shape[1] + 1) + 0.5) * fit.problem.experiment.sample_rate_hz / n
    return _tested(edges, power, tail, (power - 1) * count)


def excess_by_time(fit: RingDownFit) -> Excess:
    """Return the residual's power in windows after the tap."""
    edges = np.array(WINDOWS_S)
    energy, count = (by_load.sum(axis=1) for by_load in _summed(fit, edges, _in_time(fit)))
    used = count[0] > 0
    energy, count = energy[:, used], count[:, used]
    edges = np.append(edges[:-1][used], edges[1:][used][-1])
    z = (energy - count) / np.sqrt(2 * count + (fit.problem.experiment.level_error * count) ** 2)
    return _tested(edges, energy / count, norm.sf(z), energy - count)


def _tested(edges: Real, power: Real, tail: Real, gain: Real) -> Excess:
    sure = tail * tail.size < SURE
    return Excess(edges, power, sure, p_of(float(tail.min()), tail.size), float(np.sum(gain[sure])))


def spectrum(fit: RingDownFit) -> tuple[Real, Real]:
    """Return frequencies (n,), Hz, and the mean power (channels, n) of the whitened residuals; noise alone gives 1."""
    found = excess_by_frequency(fit)
    return (found.edges[:-1] + found.edges[1:]) / 2, found.power


def map_by_frequency(fit: RingDownFit) -> ExcessMap:
    """Return the residual's power by load in bands of equal width in the logarithm of frequency."""
    rate = fit.problem.experiment.sample_rate_hz

    def powers(row: Real) -> tuple[Real, Real]:
        at = np.asarray(np.fft.rfftfreq(row.size, 1 / rate), np.float64)
        return np.abs(np.fft.rfft(row)) ** 2 / row.size, at

    return _map(fit, np.geomspace(LOWEST_HZ, rate / 2, BANDS + 1), powers)


def map_by_time(fit: RingDownFit) -> ExcessMap:
    """Return the residual's power by load in windows after the pulse."""
    return _map(fit, np.array(WINDOWS_S), _in_time(fit))


def _in_time(fit: RingDownFit) -> Powers:
    return lambda row: (row**2, np.arange(row.size) / fit.problem.experiment.sample_rate_hz)


def _map(fit: RingDownFit, edges: Real, powers: Powers) -> ExcessMap:
    loads = fit.problem.experiment.loads_n
    total, count = _summed(fit, edges, powers)
    power = np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
    last = int(np.flatnonzero(count.any(axis=(0, 1)))[-1]) + 1
    order = np.argsort(loads)
    return ExcessMap(tuple(float(loads[i]) for i in order), edges[: last + 1], power[:, order, :last])


def _summed(fit: RingDownFit, edges: Real, powers: Powers) -> tuple[Real, Real]:
    """Return (channels, loads, bins) the sums of the powers, and of how many."""
    shape = len(fit.residuals[0]), len(fit.problem.experiment.loads_n), edges.size - 1
    total, count = np.zeros(shape), np.zeros(shape)
    for segment, residual in zip(fit.problem.experiment.segments, fit.residuals, strict=True):
        for c, row in enumerate(rotated(residual)):
            power, at = powers(row)
            place = np.searchsorted(edges, at, side="right") - 1
            inside = (place >= 0) & (place < shape[2])
            total[c, segment.group] += np.bincount(place[inside], power[inside], minlength=shape[2])
            count[c, segment.group] += np.bincount(place[inside], minlength=shape[2])
    return total, count


def rotated(residual: Real) -> Real:
    """Return mean and difference (over sqrt 2) of two channels; other numbers of channels as they are."""
    if len(residual) != 2:
        return residual
    return np.stack([residual[0] + residual[1], residual[0] - residual[1]]) / math.sqrt(2)


def by_impact(fit: RingDownFit) -> Impacts:
    """Return order, load, strength and excess of every impact of a fit of the linear rig."""
    segments = fit.problem.experiment.segments
    size = np.array([r.size for r in fit.residuals])
    off = np.array([float(np.vdot(r, r)) for r in fit.residuals]) - size
    return Impacts(
        np.array([s.order for s in segments], np.float64),
        np.array([s.preload_n for s in segments]),
        fit.force_ratios(),
        off / np.sqrt(2 * size + (fit.problem.experiment.level_error * size) ** 2),
    )
