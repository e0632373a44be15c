"""Ring-downs do not tell how heavy a rig is: neither do the slopes of their fits, nor the intervals that follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.intervals import NORMAL_95, intervals
from analysis.mismatch.ring_downs.added_response import AddedResponse
from analysis.mismatch.ring_downs.candidates import as_abrupt_as_recorded
from analysis.mismatch.ring_downs.common_scale import exponent, growth, undetermined_mass
from analysis.mismatch.ring_downs.fit import RingDownFit, fit, objective_with
from analysis.mismatch.ring_downs.model import Point, RingDownModel
from sim_backend.adopted import adopted
from sim_backend.pulses import Pulse
from sim_backend.recorder import analog_filter
from sim_backend.twin import twin_record
from sim_backend.two_mass import TwoMass
from tests.analysis.ring_downs import FILTER, M1, ONSET_S, RATE_HZ, SAMPLES, problem_of, session_of
from tests.analysis.terms import at_work

FRICTION_N = 5e-4
MASS_ERROR_KG = 5e-5  # as declared


def rubbing(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
    found = [adopted("guide_friction", {"friction_force_n": FRICTION_N})]
    return twin_record(rig, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))[0]


@pytest.fixture(scope="module")
def friction() -> RingDownFit:
    problem = problem_of(session_of(rubbing)).only((0, 5, 10))
    term = at_work("guide_friction", {"friction_force_n": FRICTION_N, "rounding": 1e-6})
    return fit(problem, [term], fit(problem))


@pytest.mark.parametrize(
    ("unit", "power"),
    [("kg", 1), ("N", 1), ("N/m", 1), ("N s/m", 1), ("N/m3", 1), ("m/N", -1), ("m/N s2", -1), ("m/s", 0), ("1", 0)],
)
def test_what_grows_with_a_rig_is_told_by_its_unit(unit: str, power: int) -> None:
    assert exponent(unit) == power


def test_a_heavier_rig_under_larger_forces_moves_alike_and_slopes_say_so(friction: RingDownFit) -> None:
    added = AddedResponse(friction.problem, friction.terms, friction.substeps)
    model = RingDownModel(friction.problem, added, np.zeros(friction.covariance.shape[0], bool))
    constants = friction.constants
    point = Point(
        constants.rig, constants.load, added.start_free(), friction.coefficients, friction.segments, friction.modes,
        friction.responses,
    )  # fmt: skip
    at = model.evaluate(point)
    heavier = replace(point, rig=1.01 * point.rig, load=1.01 * point.load, free=1.01 * point.free)
    modes, to = added.modes(model.constants(heavier))
    alike = model.evaluate(replace(heavier, modes=tuple(modes), to=tuple(to)))
    for a, b in zip(at.residuals, alike.residuals, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3 * float(np.abs(a).max()))

    slopes = model.linearised(at, True, added)
    for tangent, segment in zip(slopes.tangents, friction.segments, strict=True):
        grown = growth(added, slopes.basis, point.rig, point.load[segment.group], point.free)
        moved = tangent.common @ grown
        assert np.abs(moved).max() < 1e-6 * np.abs(tangent.common * grown).max()


def test_where_a_law_knows_the_load_it_tells_how_heavy_the_rig_is(friction: RingDownFit) -> None:
    adhesion = at_work("adhesion", {"adhesion_force_share": 0.01, "adhesion_range_share": 0.5})
    assert undetermined_mass(AddedResponse(friction.problem, [adhesion], 2)) is None
    assert undetermined_mass(AddedResponse(friction.problem, friction.terms, 2)) == 0


def test_a_friction_force_is_known_no_better_than_the_masses(friction: RingDownFit) -> None:
    found = intervals(friction, 0)["friction_force_n"]
    assert found.low < FRICTION_N < found.high
    of_masses = NORMAL_95 * MASS_ERROR_KG / M1 / np.sqrt(2)
    assert (found.high - found.low) / 2 / found.value > 0.98 * of_masses


def test_what_is_left_beyond_noise_makes_an_interval_wider_by_its_root(friction: RingDownFit) -> None:
    narrow, wide = (intervals(friction, 0, left)["friction_force_n"] for left in (0.0, 100.0))
    assert (wide.high - wide.low) / (narrow.high - narrow.low) == pytest.approx(1 + 10 / NORMAL_95)


def test_a_jump_is_made_as_abrupt_as_it_was_recorded(friction: RingDownFit) -> None:
    terms = as_abrupt_as_recorded(friction)
    assert terms[0].values["rounding"] < 0.3 * friction.terms[0].values["rounding"]
    assert objective_with(friction, terms) < friction.objective
    assert objective_with(friction, friction.terms) == pytest.approx(friction.objective, rel=1e-9)
