"""Gauss-Newton with variable projection against closed forms and SciPy's solvers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from analysis.mismatch.least_squares import Stopping, minimise
from analysis.mismatch.linearised import Evaluation, Linearisation, Tangent, bounded_step, covariance
from analysis.mismatch.policy import POLICY

Real = NDArray[np.float64]
UNTIL_CONVERGED = Stopping(200, 0.0, 1e-15)


@dataclass(frozen=True)
class Point:
    common: Real
    own: tuple[Real, ...]


@dataclass
class Segments:
    """Segments ``y = x common + z own``, each with coefficients of its own, and priors on the common parameters."""

    x: list[Real]
    z: list[Real]
    y: list[Real]
    low: Real
    high: Real
    precision: Real
    approximates: bool = False
    reuses: bool = False
    bends: bool = False
    settles: bool = False
    fixed: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.fixed = np.zeros(self.low.size, bool)

    def begin(self) -> Evaluation[Point]:
        return self.evaluate(Point(np.zeros(self.low.size), tuple(np.zeros(z.shape[1]) for z in self.z)))

    def evaluate(self, at: Point) -> Evaluation[Point]:
        rows = tuple(y - x @ at.common - z @ o for x, z, y, o in zip(self.x, self.z, self.y, at.own, strict=True))
        penalty = float(self.precision @ at.common**2)
        return Evaluation(at, sum(float(r @ r) for r in rows) + penalty, penalty, rows)

    def linearise(self, at: Evaluation[Point], exact: bool) -> Linearisation:
        k = self.low.size
        tangents = tuple(Tangent.of(np.arange(k), z, x) for x, z in zip(self.x, self.z, strict=True))
        return Linearisation(
            np.eye(k), sum(t.common.T @ t.common for t in tangents) + np.diag(self.precision), tangents
        )

    def prior_slope(self, at: Evaluation[Point], basis: Real) -> Real:
        return -self.precision * at.point.common

    def bounds(self, at: Evaluation[Point]) -> tuple[Real, Real]:
        return self.low - at.point.common, self.high - at.point.common

    def moved(self, at: Evaluation[Point], step: Real, own: Sequence[Real], iteration: int) -> Evaluation[Point]:
        moved = tuple(o + s for o, s in zip(at.point.own, own, strict=True))
        return self.evaluate(Point(at.point.common + step, moved))

    def stacked(self) -> tuple[Real, Real]:
        """All unknowns at once: the matrix and the right-hand side of one linear least-squares problem."""
        k, starts = self.low.size, np.cumsum([0] + [z.shape[1] for z in self.z])
        rows = []
        for i, (x, z) in enumerate(zip(self.x, self.z, strict=True)):
            row = np.zeros((len(x), k + starts[-1]))
            row[:, :k], row[:, k + starts[i] : k + starts[i + 1]] = x, z
            rows.append(row)
        prior = np.hstack([np.diag(np.sqrt(self.precision)), np.zeros((k, starts[-1]))])
        return np.vstack([*rows, prior]), np.concatenate([*self.y, np.zeros(k)])


def segments(seed: int, bound: float = np.inf, precision: float = 0.0) -> Segments:
    rng = np.random.default_rng(seed)
    lengths, k = (30, 45, 25), 3
    x, z = [rng.standard_normal((n, k)) for n in lengths], [rng.standard_normal((n, 2)) for n in lengths]
    y = [rng.standard_normal(n) + 2 * row.sum(axis=1) for n, row in zip(lengths, x, strict=True)]
    return Segments(x, z, y, np.full(k, -bound), np.full(k, bound), np.full(k, precision))


@pytest.mark.parametrize("precision", [0.0, 40.0])
def test_a_linear_problem_with_nuisance_coefficients_has_the_solution_of_all_unknowns_at_once(precision: float) -> None:
    model = segments(1, precision=precision)
    matrix, right = model.stacked()
    expected, *_ = np.linalg.lstsq(matrix, right)
    found, _ = minimise(model, model.begin(), UNTIL_CONVERGED, POLICY.race())
    np.testing.assert_allclose(np.concatenate([found.point.common, *found.point.own]), expected, rtol=1e-9)
    assert found.objective == pytest.approx(float(np.sum((right - matrix @ expected) ** 2)))


def test_the_covariance_of_common_parameters_is_that_of_all_unknowns_at_once() -> None:
    model = segments(2, precision=3.0)
    matrix, _ = model.stacked()
    expected = np.linalg.inv(matrix.T @ matrix)[:3, :3]
    np.testing.assert_allclose(covariance(model.linearise(model.begin(), True).normal), expected, rtol=1e-9)


def test_bounds_are_kept_and_the_rest_is_the_best_beside_them() -> None:
    model = segments(3, bound=1.5)
    matrix, right = model.stacked()
    wide = np.full(matrix.shape[1] - 3, 1e9)
    expected = lsq_linear(matrix, right, (np.r_[model.low, -wide], np.r_[model.high, wide]), tol=1e-14).x
    found, _ = minimise(model, model.begin(), UNTIL_CONVERGED, POLICY.race())
    assert np.abs(found.point.common).max() == 1.5
    np.testing.assert_allclose(np.concatenate([found.point.common, *found.point.own]), expected, rtol=1e-6)


def test_what_is_fixed_stays_and_the_rest_is_the_best_beside_it() -> None:
    model = segments(4)
    model.fixed[1] = True
    matrix, right = model.stacked()
    rest, *_ = np.linalg.lstsq(np.delete(matrix, 1, axis=1), right)
    found, _ = minimise(model, model.begin(), UNTIL_CONVERGED, POLICY.race())
    np.testing.assert_allclose(np.concatenate([found.point.common, *found.point.own]), np.insert(rest, 1, 0.0))


@dataclass
class Rosenbrock:
    """Residuals ``steepness (y - x^2)`` and ``1 - x``; y is the segment's own where ``projected``."""

    projected: bool
    bends: bool = False
    approximates: bool = False
    reuses: bool = False
    settles: bool = False
    steepness: float = 10.0
    linearised: int = 0

    @property
    def fixed(self) -> NDArray[np.bool_]:
        return np.zeros(1 if self.projected else 2, bool)

    def evaluate(self, xy: Real) -> Evaluation[Real]:
        residual = -np.array([self.steepness * (xy[1] - xy[0] ** 2), xy[0] - 1])
        return Evaluation(xy, float(residual @ residual), 0.0, (residual,))

    def linearise(self, at: Evaluation[Real], exact: bool) -> Linearisation:
        self.linearised += 1
        slopes = np.array([[-2 * self.steepness * at.point[0], self.steepness], [1.0, 0.0]])
        own, common = (slopes[:, 1:], slopes[:, :1]) if self.projected else (np.zeros((2, 0)), slopes)
        tangent = Tangent.of(np.arange(common.shape[1]), own, common)
        return Linearisation(np.eye(common.shape[1]), tangent.common.T @ tangent.common, (tangent,))

    def prior_slope(self, at: Evaluation[Real], basis: Real) -> Real:
        return np.zeros(self.fixed.size)

    def bounds(self, at: Evaluation[Real]) -> tuple[Real, Real]:
        return np.full(self.fixed.size, -np.inf), np.full(self.fixed.size, np.inf)

    def moved(self, at: Evaluation[Real], step: Real, own: Sequence[Real], iteration: int) -> Evaluation[Real]:
        return self.evaluate(at.point + np.concatenate([step, own[0]]))


@pytest.mark.parametrize("projected", [False, True])
@pytest.mark.parametrize("start", [(-1.2, 1.0), (3.0, -2.0), (0.0, 10.0)])
def test_a_narrow_curved_valley_is_followed_to_its_end(start: tuple[float, float], projected: bool) -> None:
    model = Rosenbrock(projected)
    found, _ = minimise(model, model.evaluate(np.array(start)), UNTIL_CONVERGED, POLICY.race())
    np.testing.assert_allclose(found.point, [1.0, 1.0], atol=1e-6)


@pytest.mark.parametrize("start", [(-1.2, 1.0), (3.0, -2.0), (0.0, 10.0)])
def test_a_step_that_follows_a_bent_valley_needs_half_as_many_linearisations(start: tuple[float, float]) -> None:
    models = [Rosenbrock(False, bends, steepness=1000.0) for bends in (False, True)]
    for model in models:
        stopping = Stopping(2000, 1e-9, damping=1e-3)
        found, _ = minimise(model, model.evaluate(np.array(start)), stopping, POLICY.race())
        np.testing.assert_allclose(found.point, [1.0, 1.0], atol=1e-4)
    assert models[1].linearised < models[0].linearised / 2


@pytest.mark.parametrize("start", [(-1.2, 1.0), (3.0, -2.0), (0.0, 10.0)])
def test_a_step_that_is_brought_down_to_the_floor_needs_half_as_many_linearisations(
    start: tuple[float, float],
) -> None:
    models = [Rosenbrock(False, settles=settles, steepness=1000.0) for settles in (False, True)]
    for model in models:
        stopping = Stopping(2000, 1e-9, damping=1e-3)
        found, _ = minimise(model, model.evaluate(np.array(start)), stopping, POLICY.race())
        np.testing.assert_allclose(found.point, [1.0, 1.0], atol=1e-4)
    assert models[1].linearised < models[0].linearised / 2


@given(st.floats(-0.95, 0.95), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-0.5, 0.5))
def test_where_one_parameter_ends_at_its_bound_the_others_go_to_the_best_place_beside_it(
    correlation: float, first: float, second: float, begun: float
) -> None:
    slopes = np.linalg.cholesky(np.array([[1.0, correlation], [correlation, 1.0]])).T
    target = np.array([first, second])
    bounds = np.array([-0.5 - begun, -1e6]), np.array([0.5 - begun, 1e6])
    found = bounded_step(slopes.T @ slopes, slopes.T @ target, 0.0, np.zeros(2, bool), bounds)
    expected = lsq_linear(slopes, target, (bounds[0] - 1e-12, bounds[1] + 1e-12), method="bvls")
    assert found == pytest.approx(expected.x, abs=1e-6)


def test_where_one_parameter_is_held_back_the_others_know_it() -> None:
    normal = np.array([[1.0, 0.8], [0.8, 1.0]])
    ranges = np.array([-1.0, -1e6]), np.array([1.0, 1e6])
    found = bounded_step(normal, normal @ np.array([7.0, 2.0]), 0.0, np.zeros(2, bool), ranges)
    assert found == pytest.approx([1.0, 2.0 + 0.8 * (7.0 - 1.0)])


@dataclass
class Misjudged(Segments):
    """Its slopes lie at an angle to the true ones and promise so little that each step does all it promised."""

    reuses: bool = True
    tilt: Real = field(default_factory=lambda: np.zeros(0))
    evaluated: int = 0
    linearised: int = 0

    def evaluate(self, at: Point) -> Evaluation[Point]:
        self.evaluated += 1
        return super().evaluate(at)

    def linearise(self, at: Evaluation[Point], exact: bool) -> Linearisation:
        self.linearised += 1
        true = super().linearise(at, exact)
        tangents = []
        for t, x in zip(true.tangents, self.x, strict=True):
            tilted = self.tilt[: len(x), None] * np.linalg.norm(x)
            tangents.append(Tangent.of(t.where, np.zeros((len(x), 0)), 3 * (0.17 * x + 0.98 * tilted)))
        return Linearisation(true.basis, sum(t.common.T @ t.common for t in tangents), tuple(tangents))


def test_slopes_that_are_off_do_not_creep_to_the_minimum() -> None:
    rng = np.random.default_rng(4)
    x = np.zeros((40, 1))
    x[0] = 1.0
    tilt = np.zeros(40)
    tilt[1] = 1.0
    y = 300 * x[:, 0] + 0.1 * rng.standard_normal(40) * (tilt == 0)
    wide = np.array([np.inf])
    model = Misjudged([x], [np.zeros((40, 0))], [y], -wide, wide, np.zeros(1), tilt=tilt)
    found, _ = minimise(model, model.begin(), Stopping(25, 0.02), POLICY.race())
    assert found.point.common[0] == pytest.approx(300.0, abs=0.3)
    assert model.evaluated <= 10
    assert model.linearised <= 3


def test_a_segment_s_own_coefficients_are_not_tried_again_with_damping_that_does_nothing_to_them() -> None:
    model = Misjudged([np.zeros((3, 1))], [np.eye(3)], [np.ones(3)], np.zeros(1), np.zeros(1), np.zeros(1))
    model.fixed[:] = True
    model.linearise = lambda at, exact: Linearisation(  # type: ignore[method-assign]
        np.eye(1), np.zeros((1, 1)), (Tangent.of(np.arange(1), -np.eye(3), np.zeros((3, 1))),)
    )
    begun = model.begin()
    found, _ = minimise(model, begun, Stopping(25, 0.02), POLICY.race())
    assert found is begun
    assert model.evaluated == 2
