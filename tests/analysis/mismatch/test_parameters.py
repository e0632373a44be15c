"""What is fitted of a parameter, and between which bounds."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.mismatch.parameters import FreeParameter
from tests.analysis.terms import at_work


@given(st.floats(1e-6, 1e6), st.floats(1e-3, 1e3), st.booleans())
def test_a_value_comes_back_from_what_is_fitted(value: float, scale: float, log: bool) -> None:
    parameter = FreeParameter("a", "N", scale, log)
    assert parameter.outward(parameter.inward(value)) == pytest.approx(value)


@pytest.mark.parametrize("x", [-1e9, -800.0, 800.0, 1e9])
@pytest.mark.parametrize("log", [False, True])
def test_no_value_leaves_its_range(x: float, log: bool) -> None:
    parameter = FreeParameter("a", "N", 2.0, log, 0.5, 8.0)
    assert parameter.outward(x) in (0.5, 8.0)


@pytest.mark.parametrize(
    ("scale", "log", "bounds"),
    [
        (2.0, False, (0.25, 4.0)),
        (-2.0, False, (-4.0, -0.25)),
        (2.0, True, (math.log(0.25), math.log(4.0))),
    ],
)
def test_bounds_are_those_of_the_value_as_it_is_fitted(scale: float, log: bool, bounds: tuple[float, float]) -> None:
    assert FreeParameter("a", "N", scale, log, 0.5, 8.0).bounds == pytest.approx(bounds)


def test_what_is_no_parameter_of_a_mechanism_stays_fixed_in_it() -> None:
    term = at_work("micro_slip", {"slip_stiffness_share": 1e-3, "slip_reach_share": 0.1, "sliders": 8.0})
    assert term.fixed == {"sliders": 8.0}
    assert term.moved({"slip_reach_share": 0.2}).values["slip_reach_share"] == 0.2


@pytest.mark.parametrize(
    ("name", "nonlinear"),
    [
        ("hertz_stiffness", True),
        ("channel_gain", True),
        ("double_hit", True),
        ("attached_mass", False),
        ("mains_hum", False),
    ],
)
def test_laws_second_impacts_and_distorted_channels_make_a_rig_nonlinear(name: str, nonlinear: bool) -> None:
    assert at_work(name).nonlinear is nonlinear
