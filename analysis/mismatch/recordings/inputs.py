"""Measured inputs: what they do between samples and between pulses; peaks that distortions are measured by."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy import signal
from scipy.fft import next_fast_len

from analysis.mismatch.rig_description import Hold
from sim_backend.arrays import Real

MIRRORED: Final = 64  # samples put before and after an input so that its interpolation does not ring
NORMAL: Final = 1.4826  # standard deviation over the median of the magnitudes, of normal noise
PEAK: Final = 30.0  # times the noise, that pulses reach
STANDS_OUT: Final = 6.0  # times the noise, that noise does not reach
MOST_AT_WORK: Final = 0.3  # of the samples, in pulses
CORRELATED: Final = 0.3  # of neighbouring samples, from which on what lies between is no noise
LEAST_MARGIN: Final = 5  # samples before and after a pulse, or as many as it is long


def at_rest_between_pulses(u: Real) -> Real:
    """Return an input (n,) that is its mean between pulses; as it is where it is not made of pulses.

    Between pulses nothing acts, and what is recorded there is the noise of the force cell: this is the force window of
    modal testing.

    Examples
    --------
    >>> tap = np.zeros(1000)
    >>> tap[100:110] = 50.0
    >>> noisy = tap + 0.1 * np.random.default_rng(1).standard_normal(1000)
    >>> float(np.ptp(at_rest_between_pulses(noisy)[300:])), at_rest_between_pulses(tap) is tap
    (0.0, True)
    """
    off = np.abs(u - np.median(u))
    noise = NORMAL * float(np.median(off))
    if noise == 0 or off.max() < PEAK * noise:
        return u
    ends = np.flatnonzero(np.diff(np.concatenate([[False], off > STANDS_OUT * noise, [False]])))
    at_work = np.zeros(u.size, np.bool_)
    for first, last in zip(ends[::2], ends[1::2], strict=True):
        margin = max(LEAST_MARGIN, last - first)
        at_work[max(first - margin, 0) : last + margin] = True
    rest = u[~at_work] - u[~at_work].mean() if not at_work.all() else u
    correlated = float(rest[1:] @ rest[:-1]) > CORRELATED * float(rest @ rest)
    if np.mean(at_work) > MOST_AT_WORK or correlated:
        return u
    return np.where(at_work, u, u[~at_work].mean())


def at_half_substeps(inputs: Real, sub: int, hold: Hold) -> Real:
    """Return inputs (k, n) where substeps begin, at their middles and ends; at the samples where they are held."""
    if hold == "zero" or not len(inputs):
        return inputs
    samples = inputs.shape[1]
    at = np.arange((samples - 1) * 2 * sub + 1)
    if hold == "first":
        return np.array([np.interp(at / (2 * sub), np.arange(samples), u) for u in inputs])
    return np.array([raised(u, sub)[: at.size] for u in inputs])


def raised(u: Real, sub: int) -> Real:
    """Return an input at half substeps, such that parabolas through them have its spectrum up to half the rate."""
    long = np.concatenate([2 * u[0] - u[MIRRORED:0:-1], u, 2 * u[-1] - u[-2 : -MIRRORED - 2 : -1]])
    size = int(next_fast_len(long.size + 1, real=True))
    long = np.concatenate([long, np.linspace(long[-1], long[0], size - long.size + 2)[1:-1]])
    spectrum = np.fft.rfft(long) / _of_parabolas(np.fft.rfftfreq(size) / sub)
    return np.asarray(signal.resample(np.fft.irfft(spectrum, size), size * 2 * sub)[MIRRORED * 2 * sub :], np.float64)


def _of_parabolas(cycles: Real) -> Real:
    """Return how large parabolas through a sine at beginnings, middles and ends of steps, in cycles a step, show it.

    Straight lines show it ``sinc(f)^2`` times; what their middles lack, parabolas of height one add.
    """
    half = np.pi * np.maximum(cycles, 1e-4)
    height = (np.sin(half) - half * np.cos(half)) / half**3
    return np.asarray(np.sinc(cycles) ** 2 + 2 * (1 - np.cos(half)) * height, np.float64)


def peaks_of(rows: Sequence[Real]) -> dict[str, float]:
    """Return the largest magnitude in rows of any shape, and their lowest and highest value about zero."""
    low, high = min(float(r.min()) for r in rows), max(float(r.max()) for r in rows)
    return {"peak": max(-low, high), "lowest": min(low, 0.0), "highest": max(high, 0.0)}
