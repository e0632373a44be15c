"""The load cell's drift between the calibrations before and after a session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.ring_downs.load_drift import load_drift, with_load_drift
from daq.records import CalibrationPoints, RigDescription, Session
from tests.analysis.ring_downs import diagnosed, session_of, with_law
from tests.analysis.terms import listed

WEIGHTS = np.repeat([0.0, 200.0, 500.0, 1000.0], 3)


def calibrated(seed: int, zero_mv: float = 0.0) -> Session:
    rng = np.random.default_rng(seed)

    def points(offset: float) -> CalibrationPoints:
        volts = offset + 0.042 * WEIGHTS + 0.02 * rng.standard_normal(WEIGHTS.size)
        return CalibrationPoints(WEIGHTS, volts, "2026-01-01T00:00:00Z")

    return Session("", RigDescription(), (), pre=points(0.35), post=points(0.35 + zero_mv), source="s")


def beside_calibrations(of: Session) -> Session:
    return replace(session_of(with_law(), noise=0.01), pre=of.pre, post=of.post)


def test_a_gauge_that_did_not_drift_is_found_to_drift_as_often_as_the_level_says() -> None:
    p = [d.p_value for seed in range(400) if (d := load_drift([calibrated(seed)], 0.01)) is not None]
    assert len(p) == 400
    assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.045)
    assert np.mean(np.array(p) < 0.01) < 0.03


def test_a_zero_that_moved_is_named_with_an_interval_that_holds_it() -> None:
    session = beside_calibrations(calibrated(3, 0.2))
    found = diagnosed([session], [listed("load_drift")]).answer
    (named,) = found.mechanisms
    change = named.parameters["gauge_drift_mv"]
    assert (found.verdict, named.id, named.where) == ("missing_physics", "load_drift", "load cell")
    assert change.low < 0.2 < change.high
    assert named.probability > 0.9
    assert found.location is not None
    assert found.location.component == "load cell"


def test_calibrations_that_agree_change_the_p_value_and_nothing_else() -> None:
    session = beside_calibrations(calibrated(5))
    without = diagnosed([session], []).answer
    both = with_load_drift(without, [session], [listed("load_drift")], 0.01)
    assert both.verdict == "consistent"
    assert both.p_value != without.p_value
    assert replace(both, p_value=without.p_value) == without


def test_no_calibrations_no_test_of_drift() -> None:
    assert load_drift([session_of(with_law())], 0.01) is None
