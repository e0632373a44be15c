"""A record as the likelihood sees it, and a number of modes fitted to it: what they leave, and what each is worth."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from analysis.modal.exponentials import (
    MAX_ITERATIONS,
    NONE_MISSING,
    ExponentialFit,
    FitFailure,
    fit_exponentials,
    subtracted,
)

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

SURELY = 1.5  # times the distance at which half of such pairs are taken for two: nearly all are
FAR_OUT = 10.0  # of sqrt(samples): energy of a mode over the noise's variance that no colour of the noise makes
LEAST_LEFT = 1e-12  # share of the record's energy below which rounding is left
REWEIGHTED = 4  # times at most, that channels are weighed anew
SAME_WEIGHTS = 1.1  # ratio of two channels' weights, by which they may still change
SPLIT_CHANCE = 1e-4  # of taking one mode for two
OFFSET = np.ones(1, np.complex128)
SETTLING = (0.0, 1.0, -1.0, -4.0, -16.0, -64.0)  # e-folds in a stretch, of what is slow: they follow a drift, too


@dataclass(frozen=True, slots=True)
class Record:
    """What the likelihood sees.

    Attributes
    ----------
    y
        (c, n) free decay in white noise, zero at the missing samples.
    known
        (F,) sampled poles of exponentials that are no modes: 1 for an offset, a recorder's high-pass.
    missing
        Samples that are left out.
    """

    y: Real
    known: Complex = field(default_factory=lambda: OFFSET.copy())
    missing: NDArray[np.int64] = field(default_factory=lambda: NONE_MISSING.copy())

    @property
    def samples(self) -> int:
        """Samples of each channel that count."""
        return int(self.y.shape[1] - self.missing.size)


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recording in white noise, of which stretches are looked at.

    Attributes
    ----------
    y
        (c, n) samples.
    clipped
        Samples that say nothing.
    slow
        Whether something slow goes on beside the modes: a sensor that settles, a drift.
    """

    y: Real
    clipped: NDArray[np.int64]
    slow: bool = False

    def stretch(self, first: int, longest: int | None = None) -> Record:
        """What is recorded from a sample on, without clipped samples, and no longer than said."""
        last = self.y.shape[1] if longest is None else min(self.y.shape[1], first + longest)
        missing = self.clipped[(self.clipped >= first) & (self.clipped < last)] - first
        y = self.y[:, first:last].copy()
        y[:, missing] = 0.0
        if self.slow:
            return Record(y, np.exp(np.array(SETTLING) / max(1, last - first)).astype(np.complex128), missing)
        return Record(y, missing=missing)

    def until(self, end: int) -> Recorded:
        """The recording before a sample."""
        return Recorded(self.y[:, :end], self.clipped[self.clipped < end], self.slow)


@dataclass(frozen=True, slots=True)
class Model:
    """Modes of a record, and what they leave.

    Attributes
    ----------
    fit
        None where there is no mode.
    residual
        (c, n), zero at missing samples.
    left
        (c,) its sum of squares.
    """

    fit: ExponentialFit | None
    residual: Real
    left: Real

    @property
    def modes(self) -> ExponentialFit:
        """The fit of a model that holds modes."""
        if self.fit is None:
            raise FitFailure("the record holds no mode")
        return self.fit

    @property
    def poles(self) -> Complex:
        """(J,) sampled poles."""
        return np.zeros(0, np.complex128) if self.fit is None else self.fit.poles


def without_modes(record: Record) -> Model:
    """Return the model that holds no mode, only the known exponentials."""
    k = np.arange(record.y.shape[1])
    present = np.ones(k.size, np.bool_)
    present[record.missing] = False
    columns = (record.known[:, None] ** k).real.T
    found = np.linalg.lstsq(columns[present], record.y[:, present].T, rcond=None)[0]
    residual = (record.y - (columns @ found).T) * present
    return Model(None, residual, (residual**2).sum(axis=1))


def fitted(record: Record, start: Complex, before: Model, iterations: int = MAX_ITERATIONS) -> Model | None:
    """Fit modes from starting poles by maximum likelihood, the noise of each channel unknown; None if it fails."""
    left, model = before.left, None
    fixed = record.known if record.known.size else np.zeros(0, np.complex128)
    for _ in range(REWEIGHTED):
        variance = np.maximum(left, left.max() * 1e-9 + 1e-300) / record.samples
        try:
            fit = fit_exponentials(record.y, start, record.known, variance, iterations, record.missing)
        except (FitFailure, np.linalg.LinAlgError):
            return model
        residual = subtracted(record.y, fit.amplitudes, fit.poles, fit.fixed_amplitudes, fixed)
        residual[:, record.missing] = 0.0
        model = Model(fit, residual, (residual**2).sum(axis=1))
        change = model.left / np.maximum(left, 1e-300)
        if change.max() < SAME_WEIGHTS * change.min():
            break
        left, start = model.left, fit.poles
    return model


def gain(record: Record, before: Model, after: Model) -> float:
    """Twice the rise of the log-likelihood."""
    least = LEAST_LEFT * np.maximum((record.y**2).sum(axis=1), 1e-300)
    ratio = np.maximum(before.left, least) / np.maximum(after.left, least)
    return float(record.samples * np.log(ratio).sum())


def worth_of(record: Record, model: Model) -> Real:
    """Energy of each mode over the variance of the noise: twice what it adds to the log-likelihood by itself."""
    decay = np.maximum(-2 * np.log(model.poles).real, 1e-12)
    lasts = -np.expm1(-decay * record.y.shape[1]) / decay
    weight = record.samples / np.maximum(model.left, 1e-300)
    worth: Real = 2 * (weight[:, None] * np.abs(model.modes.amplitudes) ** 2).sum(axis=0) * lasts
    return worth


def strong(record: Record) -> float:
    """Energy of a mode over the noise's variance, by which it stands far out of a noise of any colour."""
    return FAR_OUT * float(np.sqrt(record.samples))


def without_weak(record: Record, model: Model) -> Real | None:
    """What is left of a record without the modes that stand far out of the noise; None if all of them do."""
    if model.fit is None:
        return None
    weak = worth_of(record, model) < strong(record)
    if not weak.any():
        return None
    rest = model.poles[~weak]
    less = fitted(record, rest, model) if rest.size else without_modes(record)
    return None if less is None else less.residual


def unresolved(record: Record, model: Model) -> Real:
    """Distances (J,), radians a sample, below which each mode may be two of like strength and shape.

    Two such modes d apart are one whose amplitude falls by the factor ``1 - d^2 k^2 / 8``. What of this a single mode
    cannot follow, k^2 without 1 and k under its decay, has to be worth what a second mode costs.
    """
    c, n = record.y.shape
    price = float(stats.chi2.isf(SPLIT_CHANCE, 2 + 2 * c))
    k = np.arange(n, dtype=np.float64)
    found = np.empty(model.poles.size)
    for i, (z, worth) in enumerate(zip(model.poles, worth_of(record, model), strict=True)):
        envelope = np.minimum(np.abs(z), 1.0) ** k
        scale = float(np.sqrt((k**2 * envelope**2).sum() / (envelope**2).sum()))
        columns = envelope[:, None] * (k[:, None] / scale) ** np.arange(3)
        left = abs(np.linalg.qr(columns)[1][2, 2]) / np.linalg.norm(envelope) * scale**2
        found[i] = SURELY * np.sqrt(8 / left) * (price / worth) ** 0.25
    return found
