"""Modes of a recording from one sample on, and whether they are the same from another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from analysis.modal.model_order import groups, modes_of, price_of_a_mode
from analysis.modal.ring_down_model import LEAST_LEFT, Model, Record, Recorded, fitted, without_modes, worth_of

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

CHANGED = 1e-4  # chance of what differs between the modes from two starts, below which they are not the same
PERIODS = 0.6  # that a mode is heard at least: of 111 starts within pulses 8 show only oscillations that are heard for
# more; of 29 modes of 15 to 30 % damping in free decays all are
TAIL_SEEN = 0.02  # chance of what a mode from two starts differs by, below which the earlier is within the pulse
SUNK = 1.5  # exponent of the energy that a mode loses between two starts, beyond which the later says little
CROWD = 3  # modes within each other's width: a step along the record may be made of them, a second hit
SURELY_HEARD = 3.0  # times what a mode costs, at which it is found
LEAST_APART = 1e-3  # of a variance, by which it differs between two starts
CURVED = 3.0  # relative errors of a decay, by which its variance is uncertain


@dataclass(frozen=True, slots=True)
class CountedModes:
    """Modes of a record from one sample on."""

    start: int
    record: Record
    model: Model

    @property
    def price(self) -> float:
        """What a mode costs, in variances of the noise."""
        return price_of_a_mode(*self.record.y.shape)

    @property
    def worth(self) -> Real:
        """Energy of each mode, in variances of the noise."""
        return worth_of(self.record, self.model) if self.model.fit is not None else np.zeros(0)

    @property
    def periods(self) -> Real:
        """Periods of each mode until it sinks in the noise; those of a faint one while its amplitude falls to 0.6."""
        s = np.log(self.model.poles)
        e_folds = np.maximum(np.log(np.maximum(self.worth / self.price, 1e-300)), 1.0) / 2
        heard: Real = np.minimum(e_folds / np.maximum(-s.real, 1e-300), self.record.y.shape[1]) * s.imag / (2 * np.pi)
        return heard

    @property
    def are_modes(self) -> bool:
        """Whether there are modes, and all are heard for longer than what a pulse is made of."""
        return self.model.fit is not None and bool((self.periods > PERIODS).all())

    @property
    def rounding(self) -> float:
        """Factor by which rounding errors exceed the noise, or 1."""
        energy, left = (self.record.y**2).sum(), self.model.left.sum()
        return float(max(1.0, LEAST_LEFT * energy / max(left, 1e-300)))


def fitted_from(recorded: Recorded, start: int, begun: CountedModes) -> CountedModes | None:
    """The same modes, fitted from another sample on; None if that fails."""
    record = recorded.stretch(start, begun.record.y.shape[1])
    model = fitted(record, begun.model.poles, without_modes(record))
    return None if model is None or model.poles.size != begun.model.poles.size else CountedModes(start, record, model)


def agree(now: CountedModes, later: CountedModes) -> bool:
    """Whether the modes from a start are those from a later one, as far as these have not sunk."""
    here, there = np.log(now.model.poles), np.log(later.model.poles)
    own, other = optimize.linear_sum_assignment(np.abs(here[:, None] - there))
    rounding = max(now.rounding, later.rounding)
    for i, j in zip(own, other, strict=True):
        if -2 * here[i].real * (later.start - now.start) > SUNK:
            continue
        if differ(now, later, int(i), int(j)) > stats.chi2.isf(TAIL_SEEN, 2) * rounding:
            return False
    return True


def differ(now: CountedModes, later: CountedModes, i: int, j: int) -> float:
    """Squared distance of a mode from two starts, in what they may differ by: of one model, Hausman's (1978)."""
    here, there = np.log(now.model.poles[i]), np.log(later.model.poles[j])
    covariance, own = later.model.modes.log_pole_covariance[j], now.model.modes.log_pole_covariance[i]
    if not np.linalg.eigvalsh(covariance)[0] > 1e-12 * np.trace(covariance):
        return float("inf")  # it is no pole of what is there
    root = np.linalg.cholesky(covariance)
    off = np.linalg.solve(root, [(here - there).real, (here - there).imag])
    share = np.linalg.solve(root, np.linalg.solve(root, own).T)
    same = now.model.poles.size == later.model.poles.size
    values, axes = np.linalg.eigh(np.eye(2) - share if same else np.eye(2) + share)
    # a covariance is as uncertain as the pole that it is of
    least = LEAST_APART + CURVED * np.sqrt(np.trace(covariance)) / abs(there.real)
    return float(((axes.T @ off) ** 2 / np.maximum(values, least)).sum())


def counted_from(recorded: Recorded, start: int, begun: Model | None, longest: int) -> CountedModes:
    """Modes from a sample on, beginning with those of a model."""
    record = recorded.stretch(start, longest)
    if begun is None or begun.fit is None:
        return CountedModes(start, record, modes_of(record))
    return CountedModes(start, record, modes_of(record, fitted(record, begun.poles, without_modes(record))))


def continues(now: CountedModes, later: CountedModes) -> bool:
    """Whether the modes from one start are those from a later one, and nothing else is in between."""
    apart = later.start - now.start
    limit = float(stats.chi2.isf(CHANGED, 2))
    here, there = np.log(now.model.poles), np.log(later.model.poles)
    own, other = optimize.linear_sum_assignment(np.abs(here[:, None] - there))
    rounding = max(now.rounding, later.rounding)
    same_here, same_there = np.zeros(here.size, np.bool_), np.zeros(there.size, np.bool_)
    for i, j in zip(own, other, strict=True):
        same_here[i] = same_there[j] = differ(now, later, int(i), int(j)) < limit * rounding
    sunk = now.worth * np.exp(2 * here.real * apart) < SURELY_HEARD * now.price
    faint = later.worth < SURELY_HEARD * later.price
    if not ((same_here | sunk).all() and (same_there | faint).all()):
        return False
    more = now.model.poles[~same_here]
    if any(len(group) >= CROWD for group in groups(more, now.record.y.shape[1])):
        return False  # that is what a step along the record is made of
    between = now.record.samples * (now.model.residual[:, :apart] ** 2).sum(axis=1) / np.maximum(now.model.left, 1e-300)
    noise = float(stats.chi2.isf(CHANGED, between.size * apart))
    return bool(between.sum() < noise * rounding)
