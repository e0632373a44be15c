"""From sessions to what is fitted: several of one rig together, and an element's constants from a pole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg

from analysis.mismatch.answer import RecordingFile
from analysis.mismatch.diagnosis import diagnose_sessions
from analysis.mismatch.ring_downs.experiment import run_up_of
from analysis.mismatch.ring_downs.sessions import element_from_pole
from analysis.session import AnalysisError
from analysis.stiffness import ResonanceError, contact_from_pole
from daq.records import Session
from mesotap.configuration.declared import header_uncertainty
from rig.settings import Filter
from rig.tube import OwnMode
from sim_backend.arrangement import tester as eq_9
from sim_backend.recorder import analog_filter
from sim_backend.two_mass import TwoMass
from tests.analysis.ring_downs import K1, K2, LOADS_N, M1, M2, RATIOS, RIG, problem_of, session_of, two_mass, with_law


def made(seed: int, noise: float = 0.01) -> Session:
    return replace(session_of(with_law(), noise=noise, seed=seed), source=f"session {seed}")


def test_loads_stay_each_sessions_own_and_every_impact_takes_part() -> None:
    problem = problem_of(made(1), made(2))
    segments = problem.experiment.segments
    assert len(segments) == 2 * len(LOADS_N) * len(RATIOS)
    assert problem.experiment.loads_n == pytest.approx((*LOADS_N, *LOADS_N))
    assert len(problem.start) == 2 * len(LOADS_N)
    assert sorted({s.group for s in segments}) == list(range(2 * len(LOADS_N)))
    assert [s.order for s in segments] == list(range(len(segments)))
    assert len({s.name for s in segments}) == len(segments)


def test_what_a_header_says_of_the_tube_springs_is_part_of_the_rig() -> None:
    session, mode = made(1), OwnMode(0.0013, 6078.0)
    header = replace(session.rig, m1_kg=M1 + 0.0027, m2_kg=M2 + 0.0027, tube_added_kg=0.0027,
                     tube_mode_kg=mode.mass_kg, tube_mode_hz=mode.frequency_hz)  # fmt: skip
    rig = problem_of(replace(session, rig=header)).arrangement
    assert rig.bodies == ("upper mass", "lower mass", "tube", "tube'")
    values = rig.declared() | {"kc": 8e6, "cc": 0.0, "ct": 0.0}
    mass, _, stiffness = rig.matrices(values)
    poles = np.sqrt(linalg.eigh(stiffness, np.diag(mass), eigvals_only=True)) / (2 * np.pi)
    whole = TwoMass(M1 + 0.0027, M2 + 0.0027, K1, K2, 8e6, 0.0, tube_mode=mode)
    assert poles[:2] == pytest.approx(whole.modes()[::2], rel=1e-7)
    assert problem_of(session).arrangement.bodies == ("upper mass", "lower mass")


def test_two_sound_sessions_together_are_consistent_and_told_by_both_names() -> None:
    sessions = [made(1), made(2)]
    files = [RecordingFile(s.source, "") for s in sessions]
    found = diagnose_sessions(sessions, RIG, header_uncertainty(sessions[0]), [], recordings=files).answer
    assert found.verdict == "consistent"
    assert [r.file for r in found.recordings] == ["session 1", "session 2"]


def test_sessions_of_different_rigs_are_refused() -> None:
    other = made(2)
    other = replace(other, rig=replace(other.rig, m1_kg=0.2))
    with pytest.raises(AnalysisError, match="session 2: its masses, springs, filter or sampling rate are not those"):
        problem_of(made(1), other)


def test_a_session_given_twice_is_refused() -> None:
    with pytest.raises(AnalysisError, match="holds the impacts of session 1 once more"):
        problem_of(made(1), replace(made(1), source="a copy"))


def test_sessions_of_different_noise_are_refused() -> None:
    with pytest.raises(AnalysisError, match=r"its noise is .* times that of the sessions together"):
        problem_of(made(1), made(2, noise=0.02))


def test_the_problem_of_a_session_is_eq_9_with_what_its_header_declares() -> None:
    rig = problem_of(made(1)).arrangement
    expected = eq_9(M1, M2, K1, K2, 1.0, 1.0, mass_uncertainty=0.0, spring_uncertainty=0.0)
    values = {p.name: p.value for p in rig.parameters} | {"kc": 8e6, "cc": 3.0}
    for found, true in zip(rig.matrices(values), expected.matrices(values), strict=True):
        assert found == pytest.approx(true)
    declared = {p.name: p for p in rig.parameters}
    assert [declared[n].value for n in ("m1", "m2", "k1", "k2")] == [M1, M2, K1, K2]


@given(st.floats(-2000.0, -1.0), st.floats(2100.0, 60_000.0))
def test_stiffness_and_damping_of_the_contact_from_a_pole_are_those_of_eq_10(decay: float, omega: float) -> None:
    rig = eq_9(M1, M2, K1, K2, 1.0, 1.0, mass_uncertainty=0.0, spring_uncertainty=0.0)
    found = element_from_pole(rig, rig.declared(), rig.element("contact"), complex(decay, omega))
    try:
        expected = contact_from_pole(complex(decay, omega), M1, M2, K1, K2)
    except ResonanceError:
        expected = None
    if expected is not None:
        assert found == pytest.approx(expected, rel=1e-9)


def test_the_contact_is_recovered_from_the_pole_it_makes() -> None:
    true = two_mass(0.4)
    rig = eq_9(M1, M2, K1, K2, true.kc, true.cc, mass_uncertainty=0.0, spring_uncertainty=0.0)
    poles = [complex(p) for p in true.poles() if p.imag > 0]
    found = element_from_pole(rig, rig.declared(), rig.element("contact"), max(poles, key=abs))
    assert found == pytest.approx((true.kc, true.cc), rel=1e-8)


@pytest.mark.parametrize(("peak", "samples"), [(1.0, 4), (30.0, 4), (1e3, 8), (2e4, 11), (1e30, 16)])
def test_a_segment_begins_when_the_filter_has_forgotten_the_pulse(peak: float, samples: int) -> None:
    low_pass = Filter(family="butterworth", highpass_hz=10.0, highpass_order=1, lowpass_hz=10000.0, lowpass_order=4)
    assert run_up_of(analog_filter(low_pass), 25000.0, peak) == samples
    slowest = 2 * np.pi * 10000.0 * np.cos(np.radians(67.5))  # of the poles of a Butterworth low-pass of fourth order
    left = peak * np.exp(-slowest * samples / 25000.0)
    assert left <= 1.0 or samples == 16


def test_without_a_filter_segments_begin_as_early_as_any() -> None:
    assert run_up_of(analog_filter(Filter(family="none")), 25000.0, 1e6) == 4


def test_however_fast_the_recorder_is_a_slow_filter_has_the_same_time_to_forget() -> None:
    slow = analog_filter(Filter(family="butterworth", lowpass_hz=5000.0, lowpass_order=6))
    taken = {rate: run_up_of(slow, rate, 1e12) / rate for rate in (25000.0, 50000.0, 100000.0)}
    assert list(taken.values()) == pytest.approx([0.64e-3] * 3)
