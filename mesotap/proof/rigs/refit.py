"""How much of something concealed survives a refit of the linear rig: the size d of its signal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.rigs.description import Key
from mesotap.proof.rigs.drives import nothing
from mesotap.proof.rigs.trial import Trial, simulated

Array = NDArray[np.float64]
STEP = 1e-5  # of a constant, for derivatives
ROUNDS = 12  # new derivatives
CHORDS = 3  # steps with the same derivatives
DAMPINGS = (0.0, 1e-6, 1e-4, 1e-2, 1.0)  # of the largest singular value's square, until a step improves
WINDOWS = (0.03, 0.1, 0.3, 1.0)  # shares of the recordings, from their beginning, that are followed one after the other
FAR = 10.0  # d from which on a refit may have lost the phase
SETTLED = 2e-3  # relative change of d at which a refit ends
RANK = 1e-7  # of the largest singular value: a direction that recordings do not determine, or only by rounding


@dataclass(frozen=True, slots=True)
class Point:
    """Free constants and beginnings of a fit."""

    values: dict[Key, float]
    starts: list[Array]


@dataclass(frozen=True, slots=True)
class Slopes:
    """Derivatives at a point: singular vectors and values of the columns, which have the norms ``size``."""

    basis: Array
    values: Array
    rows: Array
    size: Array

    def step(self, residual: Array, damping: float) -> Array:
        """Return the step that takes most of a residual away, damped."""
        damped = self.values / (self.values**2 + damping * self.values[0] ** 2)
        return np.asarray((self.rows.T * damped) @ (self.basis.T @ residual) / self.size)


@dataclass(frozen=True, slots=True)
class Fitted:
    """Where a refit ended: ``d``, and the whitened residual (all samples of all channels, then the constants')."""

    d: float
    residual: Array
    point: Point


class Refit:
    """Refits of the linear rig to altered recordings of one trial, by damped steps of Gauss and Newton."""

    def __init__(self, trial: Trial) -> None:
        self.trial = trial
        constants = trial.rig.constants()
        self.free = [key for key, constant in constants.items() if constant.free]
        self.uncertainty = {key: constants[key].uncertainty for key in self.free if constants[key].uncertainty > 0}
        self.true = Point(trial.rig.true_values(), [r.start for r in trial.records])
        first = self._derivatives(self.true)
        if first is None:
            raise ValueError("the true rig's motion is beyond what numbers hold")
        self.first = first

    def __call__(self, channels: Sequence[Array], followed: bool = True) -> Fitted:
        """Fit the linear rig to noise-free channels, one array (samples, sensors) for each recording.

        Where much is left, they are also ``followed`` from their beginning on: the phase may have been lost.
        """
        at = self._settled(channels, self.true, 1.0)
        if at.d < FAR or not followed:
            return at
        point = self.true
        for share in WINDOWS:
            other = self._settled(channels, point, share)
            point = other.point
        return min(at, other, key=lambda f: f.d)

    def _settled(self, channels: Sequence[Array], point: Point, share: float) -> Fitted:
        """Step until nothing is gained in a share of the recordings."""
        kept = self._kept(channels, share)
        residual = kept * self._residual(channels, point)
        d = float(np.linalg.norm(residual))
        at = Fitted(d if np.isfinite(d) else np.inf, residual, point)
        for _ in range(ROUNDS):
            slopes = self.first if at.point is self.true and share == 1.0 else self._derivatives(at.point, kept)
            if slopes is None:  # followed from its beginning on, a rig has run away beyond what is kept
                break
            before = at.d
            for _ in range(CHORDS):
                found = self._stepped(channels, at, slopes, kept)
                if found is None:
                    break
                at = found
            if before - at.d <= SETTLED * at.d:
                break
        return at

    def _stepped(self, channels: Sequence[Array], at: Fitted, slopes: Slopes, kept: Array) -> Fitted | None:
        """Return where a step that improves leads to, None where none does."""
        for damping in DAMPINGS:
            tried = self._moved(at.point, slopes.step(at.residual, damping))
            residual = kept * self._residual(channels, tried)
            d = float(np.linalg.norm(residual))
            if d < at.d:
                return Fitted(d, residual, tried)
        return None

    def _kept(self, channels: Sequence[Array], share: float) -> Array:
        """Return 1 for every row of the residual in a share of the recordings, from their beginning, and 0 beyond."""
        rows = [np.arange(len(c)) < share * len(c) for c in channels for _ in range(c.shape[1])]
        return np.append(np.concatenate(rows), np.ones(len(self.uncertainty))).astype(np.float64)

    def projected(self, signal: Array) -> Array:
        """Return what of a small whitened signal the refit does not take up."""
        return signal - self.first.basis @ (self.first.basis.T @ signal)

    def _whitened(self, channels: Sequence[Array]) -> Array:
        noises = self.trial.noises
        return np.concatenate([noise.whitened(c[:, i]) for c in channels for i, noise in enumerate(noises)])

    def _residual(self, channels: Sequence[Array], point: Point) -> Array:
        modelled = simulated(self.trial, point.values, point.starts)
        data = self._whitened([c - m for c, m in zip(channels, modelled, strict=True)])
        prior = [(self.true.values[k] - point.values[k]) / u for k, u in self.uncertainty.items()]
        return np.append(data, prior)

    def _moved(self, point: Point, step: Array) -> Point:
        values = dict(point.values)
        for key, change in zip(self.free, step[: len(self.free)], strict=True):
            values[key] += change
            if key[0] in ("mass", "stiffness") and values[key] <= 0:
                values[key] = point.values[key] / 2
            if key[0] == "damping":
                values[key] = max(values[key], 0.0)
        states = step[len(self.free) :].reshape(len(point.starts), -1)
        return Point(values, [start + change for start, change in zip(point.starts, states, strict=True)])

    def _derivatives(self, point: Point, kept: Array | float = 1.0) -> Slopes | None:
        """Return the derivatives at a point; None where its motion is beyond what numbers hold."""
        columns = [self._of_constant(point, key) for key in self.free] + self._of_starts(point)
        jacobian = np.stack([kept * column for column in columns], axis=1)
        if not np.all(np.isfinite(jacobian)):
            return None
        size = np.linalg.norm(jacobian, axis=0)
        size[size == 0] = 1.0
        u, s, v = np.linalg.svd(jacobian / size, full_matrices=False)
        told = s > RANK * s[0]
        return Slopes(u[:, told], s[told], v[told], size)

    def _of_constant(self, point: Point, key: Key) -> Array:
        value = point.values[key]
        step = STEP * max(abs(value), self._scale(key))
        ends = [simulated(self.trial, {**point.values, key: value + h}, point.starts) for h in (step, -step)]
        data = self._whitened([(a - b) / (2 * step) for a, b in zip(*ends, strict=True)])
        return np.append(data, [(k == key) / u for k, u in self.uncertainty.items()])

    def _scale(self, key: Key) -> float:
        """Size of a constant that may be 0."""
        rig = self.trial.rig
        if key[0] == "damping":
            stiffness = max(e.stiffness.true for e in rig.elements if e.stiffness)
            return 1e-2 * stiffness / (2 * np.pi * float(rig.plant(self.true.values).modes_hz()[-1]))
        return 1.0 if key[0] == "offset" else max(r.size for r in self.trial.records)

    def _of_starts(self, point: Point) -> list[Array]:
        """Return the responses to the unit beginnings of each recording."""
        trial, states = self.trial, point.starts[0].size
        lengths = [r.count for r in trial.records]
        longest = max(lengths)
        free = replace(trial, records=(replace(trial.records[0], drive=nothing(longest), size=0.0),))
        values = {k: 0.0 if k[0] in ("offset", "input offset") else v for k, v in point.values.items()}
        if trial.rig.input:
            values["input offset", 0] = trial.rig.input.offset.true
        sensors = len(trial.rig.sensors)
        edges = np.cumsum([0, *(n * sensors for n in lengths)])
        responses = [simulated(free, values, [unit])[0] for unit in np.eye(states)]
        columns = []
        for i, n in enumerate(lengths):
            for response in responses:
                column = np.zeros(edges[-1] + len(self.uncertainty))
                parts = [noise.whitened(response[:n, k]) for k, noise in enumerate(trial.noises)]
                column[edges[i] : edges[i + 1]] = np.concatenate(parts)
                columns.append(column)
        return columns
