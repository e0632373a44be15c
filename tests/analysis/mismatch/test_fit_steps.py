"""How a fit begins and steps: bounds known to all parameters, overstated laws begun weaker."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from analysis.mismatch.fit import LOG_STEP, OVERSTATED, _Solver
from sim_backend.mechanisms.mechanism import Quantity


def stepped(normal: np.ndarray, gradient: np.ndarray, free: np.ndarray, quantities: list[Quantity]) -> np.ndarray:
    """Return the step of a solver with these parameters of laws and nothing else."""
    solver: Any = SimpleNamespace(
        size=gradient.size,
        frozen=False,
        fixed=np.zeros(gradient.size, bool),
        model=SimpleNamespace(free=[(0, q) for q in quantities]),
    )
    return _Solver._step(solver, normal, gradient, 0.0, free)


@given(st.floats(-0.95, 0.95), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-0.5, 0.5))
def test_where_one_parameter_ends_at_its_bound_the_others_go_to_the_best_place_beside_it(
    correlation: float, first: float, second: float, begun: float
) -> None:
    slopes = np.linalg.cholesky(np.array([[1.0, correlation], [correlation, 1.0]])).T
    target = np.array([first, second])
    found = stepped(
        slopes.T @ slopes,
        slopes.T @ target,
        np.array([begun, 0.0]),
        [Quantity("a", "1", -0.5, 0.5, ""), Quantity("b", "1", -1e6, 1e6, "")],
    )
    expected = lsq_linear(slopes, target, ([-0.5 - begun - 1e-12, -1e6], [0.5 - begun + 1e-12, 1e6]))
    assert found == pytest.approx(expected.x, abs=1e-6)


def test_the_logarithm_of_a_parameter_changes_by_so_much_at_most_and_the_other_one_knows_it() -> None:
    quantities = [Quantity("a", "1", 1e-9, 1e9, "", log=True), Quantity("b", "1", -1e6, 1e6, "")]
    normal = np.array([[1.0, 0.8], [0.8, 1.0]])
    found = stepped(normal, normal @ np.array([7.0, 2.0]), np.zeros(2), quantities)
    assert found == pytest.approx([LOG_STEP, 2.0 + 0.8 * (7.0 - LOG_STEP)])


@dataclass(frozen=True)
class State:
    """All of a state that its beginning needs."""

    free: np.ndarray


@pytest.mark.parametrize(("without", "weaker"), [(10.0, True), (1e6, False), (np.inf, False)])
def test_a_law_that_makes_all_far_worse_at_its_screened_strength_begins_weaker(without: float, weaker: bool) -> None:
    def evaluated(state: State, *_: object) -> tuple[float]:
        return (10.0 + 100.0 * float(state.free[1]) ** 2,)

    strength = Quantity("share", "1", 0.0, 10.0, "")
    term = SimpleNamespace(mechanism=SimpleNamespace(strength="share"))
    other = Quantity("range", "1", 0.0, 10.0, "")
    solver: Any = SimpleNamespace(
        model=SimpleNamespace(terms=[term, term], free=[(0, strength), (1, strength), (1, other)]),
        _first_amplitudes=lambda state, *_: state,
        _evaluate=evaluated,
    )
    begun: Any = State(np.array([4.0, 4.0, 4.0]))
    state, found = _Solver._first(solver, begun, [], [], (), without)
    assert found[0] <= OVERSTATED * without
    assert bool(state.free[1] < 4.0) is weaker
    assert state.free[[0, 2]] == pytest.approx([4.0, 4.0])
