"""k_c by the hammer beside Eq. 11 on simulated sessions, and each fault of the hammer in a session told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.frequency_response.cross_check import CrossCheck, cross_checks
from calibration.estimate import Estimate
from daq.records import Impact, RigDescription, Session
from daq.settings import Trigger
from daq.trigger import record_impact
from mesotap.answers.frequency_response import cross_check_json, said_of
from rig.settings import Hammer, RigSettings, Wiring
from sim_backend.rig import SimulatedRig
from sim_backend.settings import BadTaps, SimBackendSettings

RIG = RigSettings(wiring=Wiring(hammer=Hammer(input=3)))
NONE_BAD = BadTaps(double=0, too_hard=0, too_weak=0, off_centre=0, clipped=0)
TAPS = 4


def _session(settings: RigSettings) -> tuple[Session, float]:
    """Return a session of four taps at one load, and the true k_c."""
    rig = SimulatedRig(settings, SimBackendSettings(bad_taps=NONE_BAD, parameter_errors=False), seed=3)
    rig.stage.move_by(149.0)
    rig.stage.advance(10.0, 0.1, lambda: rig.true_load_mn() >= 500.0)
    impacts = []
    for number in range(TAPS):
        r = record_impact(rig.accelerometers, rig.impactor, rig.clock, Trigger(), 500.0)
        place = (number, 0, 500.0, 500.0, 500.0, r.time, r.sample_rate_hz, r.pretrigger, r.acceleration)
        impacts.append(Impact(*place, accepted=True, force=r.force))
    k1, k2 = settings.spring_stiffness()
    corners = settings.filter
    described = RigDescription(
        m1_kg=settings.masses.m1_kg,
        m2_kg=settings.masses.m2_kg,
        k1_n_per_m=k1,
        k2_n_per_m=k2,
        sample_rate_hz=settings.wiring.sample_rate_hz,
        highpass_hz=corners.highpass_hz,
        highpass_order=corners.highpass_order,
        lowpass_hz=corners.lowpass_hz,
        lowpass_order=corners.lowpass_order,
        filter_family="butterworth",
    )
    truth = rig.truth_at_load(rig.true_load_mn() * 1e-3)["contact_stiffness_n_per_m"]
    return Session("2026-01-01T00:00:00Z", described, tuple(impacts)), truth


@pytest.fixture(scope="module")
def simulated() -> tuple[Session, float]:
    return _session(RIG)


def _check(session: Session, k_c: float, settings: RigSettings = RIG) -> CrossCheck:
    by_eq_11 = Estimate(k_c, 1e-3 * k_c)
    return cross_checks(session, [(0, by_eq_11)], settings.masses, settings.springs, settings.wiring)[0]


def _with_force(session: Session, change, which=range(TAPS)) -> Session:
    return replace(
        session,
        impacts=tuple(
            replace(i, force=change(i.force)) if number in which else i for number, i in enumerate(session.impacts)
        ),
    )


def test_both_agree_and_the_masses_are_those_weighed(simulated) -> None:
    session, truth = simulated
    found = _check(session, truth)
    assert found.fit is not None
    assert found.fit.contact_stiffness.value == pytest.approx(truth, rel=4e-3)
    assert found.fit.mass_sum.value == pytest.approx(0.215, rel=4e-3)
    # the sensitivities: 1.5 % of the hammer, 1.5 % of each of two accelerometers
    assert found.fit.mass_sum.standard_error / 0.215 == pytest.approx(np.hypot(0.015, 0.015 / np.sqrt(2)), rel=0.05)
    assert found.agrees is True
    assert "agrees with Eq. 11" in found.sentence
    assert found.notes == ()


def test_a_hammer_that_does_not_pass_the_filter_agrees_as_well() -> None:
    settings = RigSettings(wiring=Wiring(hammer=Hammer(input=3, filtered=False)))
    session, truth = _session(settings)
    found = _check(session, truth, settings)
    assert found.fit is not None
    # the pulse is sampled without a low-pass: what lies above half the rate folds down
    assert found.fit.contact_stiffness.value == pytest.approx(truth, rel=0.01)
    assert found.fit.mass_sum.value == pytest.approx(0.215, rel=0.01)


def test_a_k_c_that_is_wrong_by_a_tenth_differs(simulated) -> None:
    session, truth = simulated
    found = _check(session, 0.9 * truth)
    assert found.agrees is False
    assert found.standard_errors > 4
    said = said_of([found])
    assert "agrees with that of Eq. 11 at 0 of 1 loads, not at 500 mN" in said[0]
    assert any("only their sum" in sentence for sentence in said)


@pytest.mark.parametrize(
    ("factor", "said"), [(4.448, "4.448 or its inverse: the force reads too high"), (1 / 4.448, "reads too low")]
)
def test_pounds_force_for_newtons_are_told_with_what_else_it_may_be(simulated, factor, said) -> None:
    session, truth = simulated
    found = _check(_with_force(session, lambda f: factor * f), truth)
    assert any(said in note and "gain" in note for note in found.notes)
    assert found.agrees is False


def test_another_factor_is_told_as_such(simulated) -> None:
    session, truth = simulated
    found = _check(_with_force(session, lambda f: 1.2 * f), truth)
    assert any("1.2 times as heavy" in note and "sensitivity or gain" in note for note in found.notes)


def test_a_reversed_sign_is_told_and_does_not_matter(simulated) -> None:
    session, truth = simulated
    found = _check(_with_force(session, lambda f: -f), truth)
    assert found.agrees is True
    assert any("its sign is reversed" in note for note in found.notes)


def test_a_dead_hammer_leaves_eq_11_alone(simulated) -> None:
    session, truth = simulated
    found = _check(_with_force(session, np.zeros_like), truth)
    assert found.fit is None
    assert found.by_ring_down is not None
    assert "never changes" in found.sentence
    written = cross_check_json(found)
    assert written["contact_stiffness_n_per_m"] is None
    assert written["agrees"] is None


def test_a_tap_beyond_the_declared_reach_is_left_out(simulated) -> None:
    session, truth = simulated
    peaks = sorted(float(i.force.max()) for i in session.impacts)
    hammer = Hammer(input=3, largest_force_n=(peaks[-1] + peaks[-2]) / 2)
    found = _check(session, truth, RigSettings(wiring=Wiring(hammer=hammer)))
    assert found.response is not None
    assert found.response.averages == TAPS - 1
    assert any("overloaded" in note for note in found.notes)


def test_taps_without_a_force_are_counted(simulated) -> None:
    session, truth = simulated
    found = _check(_with_force(session, lambda f: None, which=[1]), truth)
    assert found.response is not None
    assert found.response.averages == TAPS - 1
    assert any("1 of 4 impacts have no force" in note for note in found.notes)


def test_a_session_without_a_hammer_has_none_of_it(simulated) -> None:
    session, _ = simulated
    bare = _with_force(session, lambda f: None)
    assert cross_checks(bare, [(0, None)], RIG.masses, RIG.springs, RIG.wiring) == ()


def test_a_hammer_that_nobody_declared_is_told(simulated) -> None:
    session, truth = simulated
    found = _check(session, truth, RigSettings())
    assert found.agrees is True
    assert "declares no hammer" in found.notes[0]


def test_a_hammer_that_is_too_soft_is_told(simulated) -> None:
    """A pulse of 2 ms excites to some 800 Hz, and f2 is near 1900."""
    session, truth = simulated
    t = np.arange(50) / 25_000.0
    slow = np.sin(np.pi * t / 2e-3)

    def soft(force: np.ndarray) -> np.ndarray:
        return np.convolve(force, slow)[: force.size] / slow.sum()

    found = _check(_with_force(session, soft), truth)
    assert found.fit is None
    assert "use a harder tip" in found.sentence
