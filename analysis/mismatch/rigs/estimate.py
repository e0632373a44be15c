"""Least squares of the simulation error: constants, states and mechanisms' parameters together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.rigs.recorded import FIT, level
from analysis.mismatch.rigs.simulation import Knob, Placed, Simulation

Real = NDArray[np.float64]

STEP: Final = 1e-6  # of differences
LOST: Final = 30.0  # residual, in levels of the channel, that stands for a simulation that ran away
ROUGH_STEPS: Final = 30
ROUGH: Final = 1e-4  # relative change of the sum of squares at which a fit that only ranks rivals stops
FINE: Final = 1e-8  # likewise where the result is used
FINE_STEPS: Final = 100
FIRST_DAMPING: Final = 1e-3
LEAST_DAMPING: Final = 1e-9
MOST_TRIES: Final = 8  # of a step, each more damped
STAGES: Final = (0.05, 0.15, 0.4)  # of a free decay: its phase is followed before all of it is fitted


@dataclass(frozen=True, slots=True)
class Fitted:
    """A fitted simulation.

    Attributes
    ----------
    x
        The knobs' values as the fit sees them; ``errors`` their standard errors, with white residuals.
    scatter
        Mean square of the residuals fitted, in levels of the channels.
    """

    simulation: Simulation
    x: Real
    errors: Real
    scatter: float

    @property
    def terms(self) -> tuple[Placed, ...]:
        """Mechanisms with their fitted values."""
        return self.simulation.read(self.x)[2]

    @property
    def constants(self) -> dict[str, float]:
        """The rig's constants."""
        return self.simulation.read(self.x)[0]

    @property
    def states(self) -> list[Real]:
        """State at the beginning of what was fitted of each recording."""
        return self.simulation.read(self.x)[1]

    def knob(self, number: int, name: str) -> tuple[Knob, float, float]:
        """Return knob, x and standard error of a parameter of a term."""
        at = next(i for i, k in enumerate(self.simulation.knobs) if k.name == f"{number}:{name}")
        return self.simulation.knobs[at], float(self.x[at]), float(self.errors[at])


def residuals(simulation: Simulation, x: Real, number: int, whole: bool = False) -> tuple[Real, slice]:
    """Return simulation minus recording over the channels' levels, (c, n), and of which samples."""
    recorded = simulation.recordings[number]
    shown, at = simulation.run(x, number, whole)
    with np.errstate(over="ignore", invalid="ignore"):
        off = (shown - recorded.outputs[:, at]) / level(recorded)[:, None]
    off = np.where(np.isfinite(off), off, LOST)
    return np.asarray(np.clip(off, -LOST, LOST), np.float64), at


class _Objective:
    def __init__(self, simulation: Simulation, parts: Sequence[int], share: float, bounds: tuple[Real, Real]):
        self.simulation, self.parts, self.bounds = simulation, tuple(parts), bounds
        self.samples = [
            None if share >= 1.0 or not r.free else math.ceil(share * (r.fitted.stop - r.fitted.start))
            for r in simulation.recordings
        ]
        self.prior = [(i, *k.prior) for i, k in enumerate(simulation.knobs) if k.prior is not None]
        self.noise = 1.0

    def __call__(self, x: Real) -> Real:
        rows = []
        for number, recorded in enumerate(self.simulation.recordings):
            shown, at = self.simulation.run(x, number, samples=self.samples[number])
            used = np.isin(recorded.part[at], self.parts)
            with np.errstate(over="ignore", invalid="ignore"):
                off = ((shown - recorded.outputs[:, at]) / level(recorded)[:, None])[:, used].ravel()
            rows.append(np.clip(np.where(np.isfinite(off), off, LOST), -LOST, LOST))
        rows.append(np.array([self.noise * (x[i] - mean) / error for i, mean, error in self.prior]))
        return np.concatenate(rows)

    def slopes(self, x: Real) -> Real:
        """Return (residuals, knobs) slopes by differences, away from the bounds."""
        low, high = self.bounds
        base = self(x)
        out = np.empty((base.size, x.size))
        for i in range(x.size):
            step = STEP * max(1.0, abs(x[i]))
            if not low[i] < x[i] + step < high[i]:
                step = -step
            moved = x.copy()
            moved[i] += step
            out[:, i] = (self(moved) - base) / step
        return out


def _minimise(objective: _Objective, x: Real, most: int, tolerance: float) -> tuple[Real, Real, Real]:
    """Levenberg and Marquardt's method within bounds; return the point, its residuals and their slopes.

    A number at a bound that the slope pushes against stays there for a step; others move freely up to theirs.
    """
    low, high = objective.bounds
    off = objective(x)
    cost, damping = float(off @ off), FIRST_DAMPING
    jacobian = objective.slopes(x)
    for _ in range(most):
        slope = jacobian.T @ off
        free = ~(((x <= low) & (slope > 0)) | ((x >= high) & (slope < 0)))
        scale = np.maximum(np.linalg.norm(jacobian[:, free], axis=0), 1e-300)
        scaled = jacobian[:, free] / scale
        normal, towards = scaled.T @ scaled, scaled.T @ off
        gained = 0.0
        for _ in range(MOST_TRIES):
            step = np.zeros(x.size)
            step[free] = -np.linalg.solve(normal + damping * np.eye(towards.size), towards) / scale
            trial = np.clip(x + step, low, high)
            there = objective(trial)
            lower = float(there @ there)
            if lower < cost:
                gained = (cost - lower) / cost
                x, off, cost, damping = trial, there, lower, max(damping / 10, LEAST_DAMPING)
                break
            damping *= 10
        if gained == 0.0:
            break
        jacobian = objective.slopes(x)
        if gained < tolerance:
            break
    return x, off, jacobian


def fit(
    simulation: Simulation,
    parts: Sequence[int] = (FIT,),
    staged: bool = False,
    fine: bool = False,
) -> Fitted:
    """Fit a simulation to the samples of these parts, from its own values on.

    Parameters
    ----------
    staged
        Follow free decays from their beginning on before all of them is fitted: for a start whose frequencies are
        not yet known to within a cycle.
    fine
        Go on until it has converged, not only until rivals can be ranked.
    """
    low, high = (np.array(v) for v in zip(*(k.bounds for k in simulation.knobs), strict=True))
    x = np.clip(simulation.begin(), low, high)
    for share in (*(STAGES if staged else ()), 1.0):
        objective = _Objective(simulation, parts, share, (low, high))
        first = objective(x)
        objective.noise = float(np.sqrt(np.mean(first**2)))
        x, off, jacobian = _minimise(objective, x, FINE_STEPS if fine else ROUGH_STEPS, FINE if fine else ROUGH)
    count = off.size - len(objective.prior)
    scatter = float(np.mean(off[:count] ** 2))
    scale = np.sqrt(np.maximum(np.sum(jacobian**2, axis=0), 1e-300))
    scaled = jacobian / scale
    covariance = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12) * scatter / np.outer(scale, scale)
    return Fitted(simulation, x, np.sqrt(np.maximum(np.diag(covariance), 0.0)), scatter)
