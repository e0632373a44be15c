"""Rigs described in YAML, recorded by other integrators than the one that diagnoses them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.mismatch.rigs.contest import linear_fit
from analysis.mismatch.rigs.diagnosis import diagnose_rig
from analysis.mismatch.rigs.estimate import fit
from analysis.mismatch.rigs.recorded import HELD, prepare
from analysis.mismatch.rigs.screening import screen
from analysis.mismatch.rigs.simulation import Placed, Simulation
from analysis.session import AnalysisError
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.mechanism import element_mechanisms
from sim_backend.modal_march import MEMORY, along
from tests.analysis.mismatch.rigs.described_rigs import motion, noise_input, recorded

SAMPLES, RATE = 2400, 200.0
OMEGA = 2 * np.pi * 12
SHORT = ("tube_spring_cubic", "quadratic_damping", "guide_friction", "micro_slip", "contact_creep", "input_curvature")
KNOWN = [element_mechanisms()[name] for name in SHORT]  # enough rivals for tests that must not take long
SPRING = """
bodies: {mass: 1}
springs: [{between: [mass, ground], damping: unknown}]
"""
INPUT = "inputs: [{channel: 0, force_on: mass, gain: unknown}]\n"
PENDULUM = """
bodies: {bob: 1}
pendulums: [{between: [bob, ground]}]
sensors: [{channel: 0, of: bob, shows: displacement}]
"""
JOINT = """
bodies: {mass: 1}
joints: [{between: [mass, ground]}]
sensors: [{channel: 0, of: mass, shows: displacement}]
"""


def sensor(shows, channel=1):
    return f"sensors: [{{channel: {channel}, of: mass, shows: {shows}}}]\n"


@pytest.fixture(scope="module")
def u():
    return noise_input(SAMPLES, RATE, 2, 25, seed=3)


def named(diagnosis):
    return [m.id for m in diagnosis.mechanisms]


def duffing(u):
    y = motion(
        lambda s, x, v: 100 * s - OMEGA**2 * x * (1 + 8 * x * x) - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u
    )
    return recorded([u, y[1]], RATE, 0.01)


def test_a_linear_rig_with_coloured_noise_is_consistent(u):
    y = motion(lambda s, x, v: 100 * s - OMEGA**2 * x - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u)
    recording = recorded([u, y[0]], RATE, 0.0)
    recording.data[1] += 0.02 * y[0].std() * lfilter([1], [1, -0.9], np.random.default_rng(5).normal(size=SAMPLES))
    found = diagnose_rig(parse_rig(SPRING + INPUT + sensor("displacement")), [recording], KNOWN)
    assert found.verdict == "consistent"
    assert found.p_value > 0.01
    assert found.outcome.best.constants["stiffness of spring"] == pytest.approx(OMEGA**2, rel=5e-3)


def test_p_values_of_linear_rigs_are_not_small_too_often(u):
    rig = parse_rig(SPRING + INPUT + sensor("displacement"))
    y = motion(lambda s, x, v: 100 * s - OMEGA**2 * x - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u)
    small = 0
    for seed in range(8):
        prepared = prepare(recorded([u, y[0]], RATE, 0.03, seed), rig)
        small += screen(linear_fit(rig, [prepared]), KNOWN).p_value < 0.1
    assert small <= 4  # more than four of eight below 0.1: less than once in two thousand


def test_a_cubic_spring_seen_by_its_velocity_under_a_measured_force_is_named_alone(u):
    found = diagnose_rig(parse_rig(SPRING + INPUT + sensor("velocity")), [duffing(u)], KNOWN)
    assert found.verdict == "missing_physics"
    assert named(found) == ["tube_spring_cubic"]
    interval = found.mechanisms[0].parameters["cubic_stiffness_n_per_m3"]
    assert interval.value == pytest.approx(8 * OMEGA**2, rel=0.01)
    assert found.mechanisms[0].indistinguishable_from == ()
    assert found.rms_after < 0.03 * found.rms_before


def test_without_the_true_mechanism_nothing_is_named(u):
    rest = [m for m in KNOWN if m.id != "tube_spring_cubic"]
    found = diagnose_rig(parse_rig(SPRING + INPUT + sensor("velocity")), [duffing(u)], rest)
    assert found.verdict == "unexplained"
    assert found.mechanisms == ()
    assert found.location is not None


def test_dry_friction_of_a_slide_without_a_spring_is_named(u):
    y = motion(lambda s, x, v: 30 * s - 3 * v - 8 * np.tanh(v / 2e-3), [0.0, 0.0], SAMPLES, RATE, u)
    rig = parse_rig(
        "bodies: {mass: 1}\nslides: [{between: [mass, ground]}]\n"
        "inputs: [{channel: 0, force_on: mass, gain: 30}]\n" + sensor("displacement")
    )
    found = diagnose_rig(rig, [recorded([u, y[0]], RATE, 0.002)], KNOWN)
    assert named(found) == ["guide_friction"]
    assert found.mechanisms[0].parameters["friction_force_n"].value == pytest.approx(8, rel=0.06)


def test_a_base_that_shakes_and_drag_seen_by_acceleration(u):
    def rest(s, x, v):
        return -5 * s - OMEGA**2 * x - 0.01 * OMEGA * v - 3 * v * np.abs(v)

    y = motion(rest, [0.0, 0.0], SAMPLES, RATE, u)
    acceleration = rest(u, y[0], y[1])
    rig = parse_rig(SPRING + "inputs: [{channel: 0, base_acceleration: true, gain: 5}]\n" + sensor("acceleration"))
    found = diagnose_rig(rig, [recorded([u, acceleration], RATE, 0.01)], KNOWN)
    assert named(found) == ["quadratic_damping"]
    assert found.mechanisms[0].parameters["quadratic_damping_n_s2_per_m2"].value == pytest.approx(3, rel=0.02)


def test_a_pendulum_with_drag_is_named_by_its_sine_and_its_drag_and_time_is_not_ruled_out():
    y = motion(lambda s, x, v: -36 * np.sin(x) - 0.02 * v - 0.03 * v * np.abs(v), [0.35, 0.0], SAMPLES, 50.0)
    found = diagnose_rig(parse_rig(PENDULUM), [recorded([y[0]], 50.0, 0.003)], KNOWN)
    assert named(found) == ["tube_spring_cubic", "quadratic_damping"]
    assert found.mechanisms[0].parameters["cubic_stiffness_n_per_m3"].value == pytest.approx(-6, rel=0.03)
    assert found.mechanisms[1].parameters["quadratic_damping_n_s2_per_m2"].value == pytest.approx(0.03, rel=0.1)
    assert "contact_creep" in found.mechanisms[0].indistinguishable_from
    assert "amplitude and time" in found.mechanisms[0].statement
    assert found.next_experiment is not None
    assert "different strength" in found.next_experiment.why


def test_a_stiffness_that_settles_with_time_is_named_as_such():
    omega = 2 * np.pi * 30
    t = np.arange(3000) / 300.0

    def rest(z_t, x, v):
        return -(omega**2) * (1 + 0.01 * (1 - np.exp(-z_t / 4))) * x - 0.002 * omega * v

    y = motion(rest, [0.01, 0.0], t.size, 300.0, t)  # the "input" is the time itself
    found = diagnose_rig(parse_rig(JOINT), [recorded([y[0]], 300.0, 0.003)], KNOWN)
    assert named(found) == ["contact_creep"]
    assert found.mechanisms[0].parameters["settling_time_s"].value == pytest.approx(4, rel=0.1)


def test_masing_hysteresis_dissipates_the_area_of_its_loop_and_softens_as_its_virgin_curve():
    micro_slip = element_mechanisms()["micro_slip"]
    softening, exponent = 3.0, 1.5
    angle = np.linspace(0, 6 * np.pi, 6001)
    d, v = np.cos(angle), -np.sin(angle)
    p = np.array([0.0, 0.0, 0.0, angle[1], softening, exponent, 1.0])
    force = along(micro_slip.law, p, d, v, 0.0, angle[1], np.zeros(MEMORY))
    # area of a Masing loop whose virgin curve lacks s |d|^e: 4 s (e - 1) / (e + 1)
    last = slice(4000, 6001)
    area = np.trapezoid(force[last], d[last])
    assert area == pytest.approx(4 * softening * (exponent - 1) / (exponent + 1), rel=1e-3)
    assert force[np.argmax(angle >= 4 * np.pi)] == pytest.approx(-softening, rel=1e-6)


def test_simulation_of_a_linear_rig_is_its_exact_response():
    rig = parse_rig(
        "bodies: {mass: 2}\nsprings: [{between: [mass, ground], stiffness: 800, damping: 4}]\n"
        "inputs: [{channel: 0, force_on: mass}]\n" + sensor("displacement")
    )
    t = np.arange(SAMPLES) / RATE
    omega = 15.0
    prepared = prepare(recorded([np.sin(omega * t), np.ones(SAMPLES) + t], RATE, 0.0), rig)
    constants = {p.name: p.value for p in rig.arrangement.parameters}
    simulation = Simulation(rig, [prepared], constants, 3.2, [np.zeros(2)])
    shown, _ = simulation.run(simulation.begin(), 0)
    response = 1 / (800 - 2 * omega**2 + 1j * omega * 4)
    late = (t > 8) & (t < 11.8)  # the transient falls by e for each second; the input's end rings
    np.testing.assert_allclose(
        shown[0, late], np.imag(response * np.exp(1j * omega * t[late])), atol=5e-4 * abs(response)
    )


def test_held_out_samples_take_no_part(u):
    rig = parse_rig(SPRING + INPUT + sensor("velocity") + "recording: {held_out: [{name: end, from_s: 9}]}\n")
    good, spoilt = duffing(u), duffing(u)
    spoilt.data[1, 1900:] = 7.0
    fits = []
    for recording in (good, spoilt):
        prepared = prepare(recording, rig)
        assert np.all(prepared.part[1800:] == HELD)
        values = {"stiffness of spring": OMEGA**2, "damping of spring": 3.0, "gain of input 1": 100.0}
        constants = {p.name: values.get(p.name, p.value) for p in rig.arrangement.parameters}
        term = Placed(element_mechanisms()["tube_spring_cubic"], {"cubic_stiffness_n_per_m3": 8 * OMEGA**2}, 0)
        simulation = Simulation(rig, [prepared], constants, 12.0, [np.zeros(2)], [term])
        fits.append(fit(simulation))
    # the recording's level, by which residuals are measured, is the only thing the spoilt part changes
    np.testing.assert_allclose(fits[0].x[:2], fits[1].x[:2], rtol=2e-3)


@pytest.mark.parametrize("stiffness", [1e-12, 5.0, 15.79, 157_910.0])
def test_a_rig_described_far_from_the_one_recorded_is_not_consistent(stiffness):
    t = np.arange(3000) / 1000
    decay = np.exp(-1.5 * t) * np.sin(2 * np.pi * 20 * t)  # of 1 kg on 15,791 N/m
    rig = parse_rig(SPRING.replace("damping: unknown", f"stiffness: {stiffness}") + sensor("displacement", 0))
    found = diagnose_rig(rig, [recorded([decay], 1000.0, 3e-4)], KNOWN)
    assert found.verdict == "unexplained"
    assert found.far_off
    assert found.location is not None
    assert "most of the motion" in found.location.why
    assert found.mechanisms == ()


def test_a_gain_of_many_decades_overflows_nothing():
    t = np.arange(3000) / 1000
    decay = np.exp(-1.5 * t) * np.sin(2 * np.pi * 20 * t)
    rig = parse_rig(SPRING.replace(", damping: unknown", "") + sensor("displacement, gain: 1.0e+20", 0))
    found = diagnose_rig(rig, [recorded([decay], 1000.0, 3e-4)], list(element_mechanisms().values()))
    assert np.isfinite(found.rms_before)  # a warning of numpy's is an error in tests


def test_wrong_constants_under_a_measured_force_are_not_consistent(u):
    y = motion(lambda s, x, v: 100 * s - OMEGA**2 * x - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u)
    rig = parse_rig(
        SPRING.replace("damping", f"stiffness: {1e-3 * OMEGA**2}, damping") + INPUT + sensor("displacement")
    )
    found = diagnose_rig(rig, [recorded([u, y[0]], RATE, 1e-3)], KNOWN)
    assert (found.verdict, found.far_off) == ("unexplained", True)


@pytest.mark.parametrize("pole", [0.0, 0.9, 0.99])
def test_strong_noise_does_not_make_a_sound_rig_far_off(u, pole):
    y = motion(lambda s, x, v: 100 * s - OMEGA**2 * x - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u)[0]
    noise = lfilter([1], [1, -pole], np.random.default_rng(6).normal(size=SAMPLES))
    rig = parse_rig(SPRING + INPUT + sensor("displacement"))
    found = diagnose_rig(rig, [recorded([u, y + y.std() * noise / noise.std()], RATE, 0.0)], KNOWN)
    assert found.verdict == "consistent"
    assert not found.far_off


def test_a_recording_that_shows_nothing_is_refused():
    rig = parse_rig(JOINT)
    recording = recorded([np.ones(1000)], 100.0, 0.0)
    with pytest.raises(AnalysisError, match="constant"):
        diagnose_rig(rig, [recording], KNOWN)


def test_a_channel_that_is_not_there_is_named():
    rig = parse_rig(JOINT.replace("channel: 0", "channel: strain"))
    with pytest.raises(AnalysisError, match="no channel strain"):
        diagnose_rig(rig, [recorded([np.sin(np.arange(1000))], 100.0, 0.0)], KNOWN)
