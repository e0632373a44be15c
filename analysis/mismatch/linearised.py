"""What least squares know of a model at a point: residuals, derivatives, and the step that these ask for.

What belongs to one segment alone is eliminated (variable projection). Derivatives of residuals are, with respect to a
segment's own coefficients, ``q @ r``, and with respect to the common parameters ``q @ cross + common``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.elimination import solved
from sim_backend.arrays import Real


@dataclass(frozen=True, slots=True)
class Tangent:
    """Derivatives of a segment's residual: of its own coefficients ``q @ r``, of the common ones at ``where``."""

    where: NDArray[np.intp]
    q: Real
    r: Real
    cross: Real
    common: Real

    @classmethod
    def of(cls, where: NDArray[np.intp], own: Real, common: Real, basis: tuple[Real, Real] | None = None) -> Tangent:
        """Split derivatives (n, k) of the common parameters into what a segment's own (n, m) can mimic and the rest."""
        q, r = np.linalg.qr(own) if basis is None else basis
        cross = q.T @ common
        return cls(where, q, r, cross, common - q @ cross)


@dataclass(frozen=True, slots=True)
class Linearisation:
    """Of all segments; ``normal`` (k, k) holds the prior's part, ``basis`` what steps of the constants mean."""

    basis: Real
    normal: Real
    tangents: tuple[Tangent, ...]


Point = TypeVar("Point")


@dataclass(frozen=True, slots=True)
class Evaluation(Generic[Point]):
    """Residuals (c, n) of every segment at a point; ``penalty`` is the part of ``objective`` that priors add."""

    point: Point
    objective: float
    penalty: float
    residuals: tuple[Real, ...]

    @property
    def samples(self) -> int:
        """How many residuals there are, at least one."""
        return max(sum(r.size for r in self.residuals), 1)

    @property
    def mean_square(self) -> float:
        """Mean square of the residuals."""
        return (self.objective - self.penalty) / self.samples


class Fitted(Protocol[Point]):
    """What the solver asks of a model.

    ``approximates`` says whether it has cheaper derivatives that leave out the model's own nonlinearity; ``reuses``,
    whether derivatives are so costly that they serve for a second step where the first went as expected; ``bends``,
    whether a damped step is worth another evaluation to follow a bent valley; ``settles``, whether further steps
    with the same derivatives bring it down to the floor of the valley.
    """

    fixed: NDArray[np.bool_]
    approximates: bool
    reuses: bool
    bends: bool
    settles: bool

    def linearise(self, at: Evaluation[Point], exact: bool) -> Linearisation:
        """Return the derivatives of every segment."""

    def prior_slope(self, at: Evaluation[Point], basis: Real) -> Real:
        """Return (k,) half the negative slope of the penalty."""

    def bounds(self, at: Evaluation[Point]) -> tuple[Real, Real]:
        """Return how far a step may go down and up, (k,) each."""

    def moved(self, at: Evaluation[Point], step: Real, own: Sequence[Real], iteration: int) -> Evaluation[Point] | None:
        """Return the evaluation after a step; None where the model has none there."""


def gradient_of(model: Fitted[Point], slopes: Linearisation, at: Evaluation[Point]) -> tuple[Real, list[Real]]:
    """Return the gradient (k,), and what of each segment's residual its own coefficients can take up."""
    gradient, targets = model.prior_slope(at, slopes.basis), []
    for tangent, residual in zip(slopes.tangents, at.residuals, strict=True):
        gradient[tangent.where] += tangent.common.T @ residual.ravel()
        targets.append(tangent.q.T @ residual.ravel())
    return gradient, targets


def own_steps(slopes: Linearisation, targets: Sequence[Real], step: Real) -> list[Real]:
    """Return the step of each segment's own coefficients that belongs to a step of the common parameters."""
    return [
        solved(t.r, target - t.cross @ step[t.where], rcond=1e-12)
        for t, target in zip(slopes.tangents, targets, strict=True)
    ]


def bounded_step(
    normal: Real, gradient: Real, damping: float, fixed: NDArray[np.bool_], bounds: tuple[Real, Real]
) -> Real:
    """Return the damped step (k,); parameters that it would lead too far end at their bound, and the others know it."""
    lowest, highest = bounds
    step = np.zeros(gradient.size)
    free = ~fixed
    while free.any():
        at, ended = np.flatnonzero(free), np.flatnonzero(~free)
        scale = np.sqrt(np.maximum(np.diag(normal)[at], 1e-300))
        scaled = normal[np.ix_(at, at)] / np.outer(scale, scale) + damping * np.eye(at.size)
        left = gradient[at] - normal[np.ix_(at, ended)] @ step[ended]
        step[at] = solved(scaled, left / scale, rcond=1e-13) / scale
        beyond = at[(step[at] < lowest[at]) | (step[at] > highest[at])]
        if beyond.size == 0:
            break
        step[beyond] = np.clip(step[beyond], lowest[beyond], highest[beyond])
        free[beyond] = False
    return step


def covariance(normal: Real) -> Real:
    """Return the inverse (k, k) of a normal matrix, whatever the scales of its parameters."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scales = np.outer(scale, scale)
    return solved(normal / scales, np.eye(scale.size), rcond=1e-12) / scales
