"""How a fit of ring-downs begins and steps: overstated laws begin weaker, logarithms change by so much at most."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.mismatch.linearised import covariance
from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs import point as point_module
from analysis.mismatch.ring_downs.added_response import AddedResponse
from analysis.mismatch.ring_downs.fit import RingDownFit, fit
from analysis.mismatch.ring_downs.model import LOG_STEP, OVERSTATED, RingDownModel
from analysis.mismatch.ring_downs.point import Point
from tests.analysis.ring_downs import problem_of, session_of, with_law
from tests.analysis.terms import at_work


@pytest.fixture(scope="module")
def linear() -> RingDownFit:
    return fit(problem_of(session_of(with_law(), noise=0.02)).only((0, 5, 10)))


def begun(linear: RingDownFit, *terms: Term) -> tuple[RingDownModel, Point]:
    added = AddedResponse(linear.problem, terms, 2)
    rig, load = linear.constants.rig.copy(), linear.constants.load.copy()
    model = RingDownModel(linear.problem, added, np.zeros(rig.size + load.size + len(added.free), bool))
    point = Point(rig, load, added.start_free(), tuple(np.zeros(0) for _ in linear.segments), linear.segments)
    return model, point


@pytest.mark.parametrize(("over_linear", "weaker"), [(1.0, True), (1e6, False), (math.inf, False)])
def test_a_law_that_makes_all_far_worse_at_its_screened_strength_begins_weaker(
    linear: RingDownFit, over_linear: float, weaker: bool
) -> None:
    friction = at_work("guide_friction", {"friction_force_n": 1e-6, "rounding": 0.05})
    adhesion = at_work(
        "adhesion",
        {"adhesion_force_share": 0.3, "adhesion_range_share": 0.5},
    )
    model, point = begun(linear, friction, adhesion)
    objective = over_linear * linear.objective
    found = model.begin(point, linear.amplitudes, objective)
    assert found.objective <= OVERSTATED * objective
    names = [q.name for q in model.added.free]
    strength = names.index("adhesion_force_share")
    assert bool(model.added.free[strength].outward(found.point.free[strength]) < 0.299) is weaker
    others = [k for k in range(len(names)) if k != strength]
    np.testing.assert_array_equal(found.point.free[others], point.free[others])


def test_the_logarithm_of_a_parameter_changes_by_so_much_at_most(linear: RingDownFit) -> None:
    slip = at_work("micro_slip", {"slip_stiffness_share": 1e-3, "slip_reach_share": 0.3, "sliders": 1.0})
    model, point = begun(linear, slip)
    at = model.begin(point, linear.amplitudes, math.inf)
    low, high = model.bounds(at)
    logs = [model.at_free + k for k, q in enumerate(model.added.free) if q.log]
    assert logs
    np.testing.assert_allclose(high[logs], LOG_STEP)
    np.testing.assert_allclose(low[logs], -LOG_STEP)


@pytest.mark.parametrize(("force_n", "slight"), [(1e-5, True), (0.1, False)])
def test_plain_slopes_serve_where_what_a_law_adds_is_slight(
    linear: RingDownFit, force_n: float, slight: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, point = begun(linear, at_work("guide_friction", {"friction_force_n": force_n, "rounding": 0.05}))
    at = model.begin(point, linear.amplitudes, math.inf)
    assert at.point.slight is slight
    served, plain = (model.linearised(at, exact, model.smooth).normal for exact in (True, False))
    assert np.array_equal(served, plain) is slight
    monkeypatch.setattr(point_module, "SLIGHT", 0.0)
    full = model.linearised(at, True, model.smooth).normal
    assert not np.array_equal(full, plain)
    errors = [np.sqrt(np.diag(covariance(normal))) for normal in (served, full)]
    np.testing.assert_allclose(*errors, rtol=0.05 if slight else 1e-12)
