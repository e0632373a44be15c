"""Residuals and derivatives of simulated recordings, as the least-squares solver asks for them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.least_squares import Evaluation, Linearisation, Tangent
from analysis.mismatch.recordings.recorded import level
from analysis.mismatch.recordings.simulation import Own, Simulation

Real = NDArray[np.float64]

STEP = 1e-6  # of differences
LOST = 30.0  # residual, in levels of the channel, that stands for a simulation that ran away


def residual(
    simulation: Simulation, x: Real, own: Own, number: int, whole: bool = False, samples: int | None = None
) -> tuple[Real, slice]:
    """Return simulation minus recording over the channels' levels, (c, n), and of which samples."""
    recorded = simulation.recordings[number]
    shown, at = simulation.run(x, own, number, whole, samples)
    with np.errstate(over="ignore", invalid="ignore"):
        off = (shown - recorded.outputs[:, at]) / level(recorded)[:, None]
    return np.asarray(np.clip(np.where(np.isfinite(off), off, LOST), -LOST, LOST), np.float64), at


@dataclass(frozen=True, slots=True)
class Point:
    """Parameters (k,) as they are fitted, and what is each recording's own."""

    x: Real
    own: tuple[Own, ...]


class SimulationModel:
    """See `analysis.mismatch.least_squares.Fitted`; ``share`` of a free decay is fitted, of these parts."""

    approximates, reuses = False, False

    def __init__(self, simulation: Simulation, own: Sequence[Own], parts: Sequence[int], share: float):
        self.simulation, self.parts = simulation, tuple(parts)
        self.scales = [
            np.concatenate([simulation.state_scale(i, o.state), np.ones(o.tones.size)]) for i, o in enumerate(own)
        ]
        low, high = zip(*(p.bounds for p in simulation.parameters), strict=True) if simulation.parameters else ((), ())
        self.low, self.high = np.array(low), np.array(high)
        self.fixed = np.zeros(self.low.size, bool)
        self.samples = [
            None if share >= 1.0 or not r.free else math.ceil(share * (r.fitted.stop - r.fitted.start))
            for r in simulation.recordings
        ]
        self.prior = [(i, *p.prior) for i, p in enumerate(simulation.parameters) if p.prior is not None]
        self.noise = 1.0  # variance by which priors are weighed

    def used(self, x: Real, own: Own, number: int) -> Real:
        """Return minus the residual (c, m) at the samples that are fitted."""
        off, at = residual(self.simulation, x, own, number, samples=self.samples[number])
        return -off[:, np.isin(self.simulation.recordings[number].part[at], self.parts)]

    def evaluate(self, point: Point) -> Evaluation[Point]:
        """Return the residuals at a point."""
        rows = tuple(self.used(point.x, o, i) for i, o in enumerate(point.own))
        penalty = self.noise * sum(((point.x[i] - mean) / error) ** 2 for i, mean, error in self.prior)
        return Evaluation(point, sum(float(np.vdot(r, r)) for r in rows) + penalty, float(penalty), rows)

    def linearise(self, at: Evaluation[Point], exact: bool) -> Linearisation:
        """Return the derivatives of every recording, by differences."""
        x, k = at.point.x, at.point.x.size
        normal, tangents = np.zeros((k, k)), []
        for number, (own, base) in enumerate(zip(at.point.own, at.residuals, strict=True)):
            common = np.empty((base.size, k))
            for i in range(k):
                step = STEP * max(1.0, abs(x[i]))
                if not self.low[i] < x[i] + step < self.high[i]:
                    step = -step
                moved = x.copy()
                moved[i] += step
                common[:, i] = (base - self.used(moved, own, number)).ravel() / step
            tangent = Tangent.of(np.arange(k), self._own_slopes(at.point, number, base), common)
            normal += tangent.common.T @ tangent.common
            tangents.append(tangent)
        for i, _, error in self.prior:
            normal[i, i] += self.noise / error**2
        return Linearisation(np.eye(k), normal, tuple(tangents))

    def _own_slopes(self, point: Point, number: int, base: Real) -> Real:
        """Return (m, own) what the recording's own state and tones do."""
        own, scale = point.own[number], self.scales[number]
        slopes = np.empty((base.size, own.size))
        for j in range(own.size):
            step = np.zeros(own.size)
            step[j] = STEP * scale[j]
            slopes[:, j] = (base - self.used(point.x, own.moved(step), number)).ravel() / STEP
        return slopes

    def prior_slope(self, at: Evaluation[Point], basis: Real) -> Real:
        """Return half the negative slope of the penalty."""
        out = np.zeros(at.point.x.size)
        for i, mean, error in self.prior:
            out[i] = -self.noise * (at.point.x[i] - mean) / error**2
        return out

    def bounds(self, at: Evaluation[Point]) -> tuple[Real, Real]:
        """Return how far each parameter may go."""
        return self.low - at.point.x, self.high - at.point.x

    def moved(self, at: Evaluation[Point], step: Real, own: Sequence[Real], iteration: int) -> Evaluation[Point] | None:
        """Return the evaluation after a step."""
        x = np.clip(at.point.x + step, self.low, self.high)
        moved = [o.moved(s * scale) for o, s, scale in zip(at.point.own, own, self.scales, strict=True)]
        found = self.evaluate(Point(x, tuple(moved)))
        return found if math.isfinite(found.objective) else None
