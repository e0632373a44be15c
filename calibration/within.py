"""What the readings of calibrations, in their order in time, tell of how fast the gauge's zero wanders."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.curve import HungWeights
from daq.records import CalibrationPoints

FloatArray = NDArray[np.float64]

FEWEST_CONTRASTS = 3  # with fewer, scatter and wandering are not told apart
MOST_TIMED = 500  # readings of a calibration up to which their times are looked at: a person hangs no more weights
_NOISE_VARIANCES = np.geomspace(1e-3, 10.0, 41)  # of a reading, considered; over the mean square of what is left
_ROUNDING = 1e-18  # of the mean square of the voltages: below it, nothing is left


class WithinCalibrations:
    """Likelihood of the rate at which the zero wanders, from the times of the readings within each calibration.

    Every weight may be off by an amount that repeats, and by another on the way down; each calibration has its own
    line. What is left beside that are contrasts of the noise of the readings, white and of unknown size (its logarithm
    uniform, integrated out), and of the random walk of the zero. They say nothing of the level of the zero, so that
    the change from one calibration to the next is further evidence.

    Parameters
    ----------
    calibrations
        Those whose readings have times; others, and those in which nothing is repeated, tell nothing.

    Attributes
    ----------
    contrasts
        How many there are.
    """

    def __init__(self, calibrations: Sequence[CalibrationPoints]) -> None:
        times = [(points, hours) for points in calibrations if (hours := _hours(points)) is not None]
        self.contrasts = 0
        self._per_hour, self._squares = np.zeros(0), np.zeros(0)
        if not times:
            return
        basis, voltage = _contrasts([points for points, _ in times])
        walk = _walk([hours for _, hours in times])
        per_hour, turned = np.linalg.eigh(basis.T @ walk @ basis)
        squares = (turned.T @ (basis.T @ voltage)) ** 2
        if len(squares) >= FEWEST_CONTRASTS and float(np.mean(squares)) > _ROUNDING * float(np.mean(voltage**2)):
            self.contrasts = len(squares)
            self._per_hour, self._squares = np.maximum(per_hour, 0.0), squares

    def log_likelihood(self, rates: FloatArray) -> FloatArray:
        """(r,) log-likelihood of (r,) variances of the walk in an hour, mV^2; zero where nothing can be told."""
        if not self.contrasts:
            return np.zeros(len(rates))
        noise = float(np.mean(self._squares)) * _NOISE_VARIANCES
        variance = rates[:, None, None] * self._per_hour + noise[:, None]
        log = -0.5 * (np.log(variance) + self._squares / variance).sum(axis=2)
        most = log.max()
        return np.asarray(np.log(np.exp(log - most).mean(axis=1) + np.exp(-700.0)) + most, dtype=np.float64)


def _hours(points: CalibrationPoints) -> FloatArray | None:
    """(n,) times of the readings of a calibration since its first, h; None where they are not known."""
    if points.elapsed_s is None or not 1 < len(points.elapsed_s) == len(points.load_mn) <= MOST_TIMED:
        return None
    hours = np.asarray(points.elapsed_s, dtype=np.float64) / 3600
    return hours if np.isfinite(hours).all() else None


def _contrasts(calibrations: Sequence[CalibrationPoints]) -> tuple[FloatArray, FloatArray]:
    """(n, k) orthonormal contrasts that lines, weights and loops do not reach, and the (n,) voltages."""
    r = HungWeights.of(calibrations)
    loops = r.hung[:, r.both] * r.direction[:, None]
    design = np.hstack([r.own, r.own * r.x[:, None], r.hung, loops])
    left, size, _ = np.linalg.svd(design, full_matrices=True)
    rank = int(np.sum(size > 1e-9 * size[0]))
    return left[:, rank:], r.voltage


def _walk(hours: Sequence[FloatArray]) -> FloatArray:
    """Covariance of a walk of unit rate at the readings of each calibration, from its first; levels do not matter."""
    n = sum(len(h) for h in hours)
    covariance, begin = np.zeros((n, n)), 0
    for h in hours:
        since, end = h - h.min(), begin + len(h)
        covariance[begin:end, begin:end] = np.minimum(since[:, None], since[None, :])
        begin = end
    return covariance
