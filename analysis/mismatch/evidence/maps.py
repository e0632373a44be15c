"""Where a fit leaves more than noise: by load and frequency, load and time, impact; and held-out impacts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.excess import WINDOWS_S, excess_by_record, rotated
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.selection import Selection

Real = NDArray[np.float64]

BANDS = 28
LOWEST_HZ = 100.0


@dataclass(frozen=True, slots=True)
class ExcessMap:
    """Power of the residual over that of the noise, (channels, loads, bins); NaN where there are no samples.

    The channels are mean and difference of A and B, or the channels themselves where there are not two. ``edges``
    (bins + 1,) in Hz or s; ``loads_n`` ascending.
    """

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


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Impacts that took no part in choosing or fitting, before and after what was left out is put in.

    Attributes
    ----------
    before, after
        Fits of these impacts; ``after`` is None where there is nothing to put in.
    rms_before, rms_after
        (impacts,) of their residuals, m/s2.
    """

    before: RingDownFit
    after: RingDownFit | None
    rms_before: Real
    rms_after: Real | None


def map_by_frequency(fitted: RingDownFit) -> ExcessMap:
    """Return the residual's power by load in bands of equal width in the logarithm of frequency."""
    rate = fitted.problem.experiment.sample_rate_hz
    edges = np.geomspace(LOWEST_HZ, rate / 2, BANDS + 1)

    def binned(row: Real) -> tuple[Real, Real]:
        power = np.abs(np.fft.rfft(row)) ** 2 / row.size
        place = np.searchsorted(edges, np.fft.rfftfreq(row.size, 1 / rate), side="right") - 1
        return _binned(power, place, BANDS)

    return _map(fitted, edges, binned)


def map_by_time(fitted: RingDownFit) -> ExcessMap:
    """Return the residual's power by load in windows after the pulse."""
    rate = fitted.problem.experiment.sample_rate_hz
    edges = np.array(WINDOWS_S)

    def binned(row: Real) -> tuple[Real, Real]:
        place = np.searchsorted(edges, np.arange(row.size) / rate, side="right") - 1
        return _binned(row**2, place, edges.size - 1)

    return _map(fitted, edges, binned)


def _binned(power: Real, place: NDArray[np.intp], bins: int) -> tuple[Real, Real]:
    inside = (place >= 0) & (place < bins)
    total = np.bincount(place[inside], power[inside], minlength=bins).astype(np.float64)
    count = np.bincount(place[inside], minlength=bins).astype(np.float64)
    return total, count


def _map(fitted: RingDownFit, edges: Real, binned) -> ExcessMap:  # type: ignore[no-untyped-def]
    loads = fitted.problem.experiment.loads_n
    channels = len(rotated(fitted.residuals[0]))
    total, count = np.zeros((2, channels, len(loads), edges.size - 1))
    for segment, residual in zip(fitted.problem.experiment.segments, fitted.residuals, strict=True):
        for c, row in enumerate(rotated(residual)):
            added, number = binned(row)
            total[c, segment.group] += added
            count[c, segment.group] += number
    power = np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
    used = ~np.all(np.isnan(power), axis=(0, 1))
    last = int(np.flatnonzero(used)[-1]) + 1
    order = np.argsort(loads)
    return ExcessMap(tuple(float(loads[i]) for i in order), edges[: last + 1], power[:, order, :last])


def by_impact(fitted: RingDownFit) -> Impacts:
    """Return order, load, strength and reduced_chi_squared of every impact of a fit of the linear rig."""
    segments = fitted.problem.experiment.segments
    return Impacts(
        np.array([r.order for r in segments], np.float64),
        np.array([r.preload_n for r in segments]),
        fitted.force_ratios(),
        excess_by_record(fitted),
    )


def held_out(selection: Selection[RingDownFit]) -> HeldOut | None:
    """Fit what belongs to each impact on the held-out ones, before and after; None where none is held out."""
    judge = selection.judge
    if not isinstance(judge, ImpactJudge) or not judge.held_out:
        return None
    before = judge.held_out_fit(selection.baseline)
    after = judge.held_out_fit(selection.best) if selection.best.terms else None
    return HeldOut(before, after, rms_by_segment(before), None if after is None else rms_by_segment(after))


def rms_by_segment(fitted: RingDownFit) -> Real:
    """Return (segments,) rms of each segment's residual, m/s2."""
    deviations = np.array([m.deviation for m in fitted.problem.experiment.noise])[:, None]
    return np.array([math.sqrt(float(np.mean((r * deviations) ** 2))) for r in fitted.residuals])


def spectrum(fitted: RingDownFit) -> tuple[Real, Real]:
    """Return frequencies (n,), Hz, and the mean power (channels, n) of the whitened residuals; noise alone gives 1."""
    n = min(r.shape[1] for r in fitted.residuals)
    power = np.mean([np.abs(np.fft.rfft(rotated(r)[:, :n], axis=1)) ** 2 / n for r in fitted.residuals], axis=0)
    frequency = np.fft.rfftfreq(n, 1 / fitted.problem.experiment.sample_rate_hz)
    return np.asarray(frequency[1:-1], np.float64), np.asarray(power[:, 1:-1], np.float64)
