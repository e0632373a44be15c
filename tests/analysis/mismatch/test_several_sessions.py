"""Several sessions of one rig together; the load cell's drift between calibrations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch import diagnosis
from analysis.mismatch.load_drift import load_drift
from analysis.session import AnalysisError
from daq.records import CalibrationPoints, Session
from sim_backend.mechanisms.mechanism import mechanisms
from tests.analysis.ring_downs import LOADS_N, RATIOS, session_of, with_law

WEIGHTS = np.repeat([0.0, 200.0, 500.0, 1000.0], 3)


def made(seed: int, noise: float = 0.01) -> Session:
    return replace(session_of(with_law("linear"), noise=noise, seed=seed), source=f"session {seed}")


def calibrated(seed: int, zero_mv: float = 0.0) -> Session:
    rng = np.random.default_rng(seed)

    def points(offset: float) -> CalibrationPoints:
        volts = offset + 0.042 * WEIGHTS + 0.02 * rng.standard_normal(WEIGHTS.size)
        return CalibrationPoints(WEIGHTS, volts, "2026-01-01T00:00:00Z")

    return Session("", diagnosis.RigDescription(), (), pre=points(0.35), post=points(0.35 + zero_mv), source="s")


def test_loads_stay_each_sessions_own_and_every_impact_takes_part() -> None:
    problem = diagnosis.tester_problem(made(1), made(2))
    records = problem.recordings.records
    assert len(records) == 2 * len(LOADS_N) * len(RATIOS)
    assert problem.recordings.loads_n == pytest.approx((*LOADS_N, *LOADS_N))
    assert len(problem.start) == 2 * len(LOADS_N)
    assert sorted({r.group for r in records}) == list(range(2 * len(LOADS_N)))
    assert [r.order for r in records] == list(range(len(records)))
    assert len({r.name for r in records}) == len(records)


def test_two_sound_sessions_together_are_consistent_and_told_by_both_names() -> None:
    found = diagnosis.diagnose_session([made(1), made(2)], [])
    assert found.verdict == "consistent"
    assert found.session == "session 1 + session 2"


def test_sessions_of_different_rigs_are_refused() -> None:
    other = made(2)
    other = replace(other, rig=replace(other.rig, m1_kg=0.2))
    with pytest.raises(AnalysisError, match="session 2: its masses, springs, filter or sampling rate are not those"):
        diagnosis.tester_problem(made(1), other)


def test_a_session_given_twice_is_refused() -> None:
    with pytest.raises(AnalysisError, match="holds the impacts of session 1 once more"):
        diagnosis.tester_problem(made(1), replace(made(1), source="a copy"))


def test_sessions_of_different_noise_are_refused() -> None:
    with pytest.raises(AnalysisError, match=r"its noise is .* times that of the sessions together"):
        diagnosis.tester_problem(made(1), made(2, noise=0.02))


def test_a_gauge_that_did_not_drift_is_found_to_drift_as_often_as_the_level_says() -> None:
    p = [d.p_value for seed in range(400) if (d := load_drift([calibrated(seed)], 0.01)) is not None]
    assert len(p) == 400
    assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.045)
    assert np.mean(np.array(p) < 0.01) < 0.03


def test_a_zero_that_moved_is_named_with_an_interval_that_holds_it() -> None:
    session = replace(made(1), pre=calibrated(3, 0.2).pre, post=calibrated(3, 0.2).post)
    found = diagnosis.diagnose_session(session, [mechanisms()["load_drift"]])
    (named,) = found.mechanisms
    change = named.parameters["gauge_drift_mv"]
    assert (found.verdict, named.id, named.where) == ("missing_physics", "load_drift", "load cell")
    assert change.low < 0.2 < change.high
    assert named.probability > 0.9
    assert found.location is not None
    assert found.location.component == "load cell"


def test_calibrations_that_agree_change_the_p_value_and_nothing_else() -> None:
    plain = made(1)
    without = diagnosis.diagnose_session(plain, [])
    both = diagnosis.with_load_drift(without, [replace(plain, pre=calibrated(5).pre, post=calibrated(5).post)])
    assert both.verdict == "consistent"
    assert not both.mechanisms


def test_no_calibrations_no_test_of_drift() -> None:
    assert load_drift([made(1)], 0.01) is None
