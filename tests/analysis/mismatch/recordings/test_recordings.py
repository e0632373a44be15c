"""Rigs described in YAML, recorded by other integrators than the one that diagnoses them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from analysis.mismatch.answer import Answer
from analysis.mismatch.diagnosis import answer_of as written_of
from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.recordings.account import BlockAccount
from analysis.mismatch.rig_description import DescribedRig
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, variants
from sim_backend.mechanisms.kinds import Mechanism
from tests.analysis.mismatch.recordings.described_rigs import (
    INPUT,
    JOINT,
    OMEGA,
    RATE,
    SAMPLES,
    SPRING,
    duffing,
    motion,
    noise_input,
    recorded,
    sensor,
)

Real = NDArray[np.float64]

SHORT = ("tube_spring_cubic", "quadratic_damping", "guide_friction", "micro_slip", "contact_creep", "input_curvature")
KNOWN = [catalogue()[name][-1] for name in SHORT]  # enough rivals for tests that must not take long
PENDULUM = """
bodies: {bob: 1}
pendulums: [{between: [bob, ground]}]
sensors: [{channel: 0, of: bob, shows: displacement}]
"""


@pytest.fixture(scope="module")
def u() -> Real:
    return noise_input(SAMPLES, RATE, 2, 25, seed=3)


def answer_of(
    rig: DescribedRig, recordings: Sequence[Recording], known: Sequence[Mechanism], learn: bool = True
) -> Answer:
    return diagnose_recordings(recordings, rig, known, learn=learn).answer


def named(answer: Answer) -> list[str]:
    return [m.id for m in answer.mechanisms]


@pytest.mark.slow
def test_a_linear_rig_with_correlated_noise_is_consistent(u: Real) -> None:
    y = motion(lambda s, x, v: 100 * s - OMEGA**2 * x - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u)
    recording = recorded([u, y[0]], RATE, 0.0)
    recording.data[1] += 0.02 * y[0].std() * lfilter([1], [1, -0.9], np.random.default_rng(5).normal(size=SAMPLES))
    found = answer_of(parse_rig(SPRING + INPUT + sensor("displacement")), [recording], KNOWN)
    assert found.verdict == "consistent"
    assert found.p_value > 0.01
    assert found.fitted is not None
    assert found.fitted.constants["stiffness of spring"].value == pytest.approx(OMEGA**2, rel=5e-3)


@pytest.mark.long
def test_a_cubic_spring_seen_by_its_velocity_under_a_measured_force_is_named_alone(u: Real) -> None:
    found = answer_of(parse_rig(SPRING + INPUT + sensor("velocity")), [duffing(u)], KNOWN)
    assert found.verdict == "missing_physics"
    assert named(found) == ["tube_spring_cubic"]
    interval = found.mechanisms[0].parameters["cubic_stiffness_n_per_m3"]
    assert interval.value == pytest.approx(8 * OMEGA**2, rel=0.01)
    assert found.mechanisms[0].indistinguishable_from == ()
    assert found.fit.heldout_rms_after is not None
    assert found.fit.heldout_rms_after < 0.03 * found.fit.heldout_rms_before


@pytest.mark.slow
def test_what_is_not_named_though_it_leaves_nothing_is_left(u: Real) -> None:
    """A verdict that nothing explains had stood beside "nothing beyond noise is left"."""
    found = diagnose_recordings([duffing(u)], parse_rig(SPRING + INPUT + sensor("velocity")), KNOWN[:1])
    assert found.answer.remainder.p_value > 0.01
    refused = written_of(BlockAccount(replace(found.selection, chosen=None)))
    assert refused.verdict == "unexplained"
    assert (refused.remainder.share, refused.remainder.p_value) == (1.0, refused.p_value)


@pytest.mark.long
def test_without_the_true_mechanism_nothing_is_named(u: Real) -> None:
    rest = [m for m in KNOWN if m.id != "tube_spring_cubic"]
    found = answer_of(parse_rig(SPRING + INPUT + sensor("velocity")), [duffing(u)], rest, learn=False)
    assert found.verdict == "unexplained"
    assert (found.remainder.share, found.remainder.p_value) == (1.0, found.p_value)
    assert found.mechanisms == ()
    assert found.location is not None
    assert found.next_experiment is not None
    assert found.next_experiment.peak_force_ratio == 0.5
    assert found.next_experiment.moves == ("input",)


@pytest.mark.long
def test_without_the_true_mechanism_its_law_is_learned(u: Real) -> None:
    rest = [m for m in KNOWN if m.id != "tube_spring_cubic"]
    found = answer_of(parse_rig(SPRING + INPUT + sensor("velocity")), [duffing(u)], rest)
    assert found.verdict == "new_physics"
    (learned,) = found.mechanisms
    assert learned.law is not None
    assert (learned.element, learned.law.kind, learned.law.symmetry) == ("spring", "static", "odd")
    exponent = learned.law.exponents["deflection"]
    assert exponent is not None
    assert exponent.value == pytest.approx(3.0, abs=0.02)  # the force between samples was a spline, no band-limited one
    assert exponent.high - exponent.low < 0.1
    assert found.fit.heldout_rms_after is not None
    assert found.fit.heldout_rms_after < 0.03 * found.fit.heldout_rms_before


@pytest.mark.long
def test_a_name_that_leaves_far_more_than_noise_gives_way_to_a_law_that_does_not(u: Real) -> None:
    def between_square_and_cube(s: float, x: Real, v: Real) -> Real:
        return 100 * s - OMEGA**2 * x * (1 + 3 * np.abs(x) ** 1.4) - 0.04 * OMEGA * v

    y = motion(between_square_and_cube, [0.0, 0.0], SAMPLES, RATE, u)
    found = answer_of(parse_rig(SPRING + INPUT + sensor("displacement")), [recorded([u, y[0]], RATE, 0.005)], KNOWN)
    assert found.verdict == "new_physics"
    (learned,) = found.mechanisms
    assert learned.law is not None
    exponent = learned.law.exponents["deflection"]
    assert exponent is not None
    assert exponent.low < 2.4 < exponent.high
    assert exponent.high - exponent.low < 0.2
    assert found.remainder.p_value > 0.01


@pytest.mark.long
def test_dry_friction_of_a_slide_without_a_spring_is_named(u: Real) -> None:
    y = motion(lambda s, x, v: 30 * s - 3 * v - 8 * np.tanh(v / 2e-3), [0.0, 0.0], SAMPLES, RATE, u)
    rig = parse_rig(
        "bodies: {mass: 1}\nslides: [{between: [mass, ground]}]\n"
        "inputs: [{channel: 0, force_on: mass, gain: 30}]\n" + sensor("displacement")
    )
    found = answer_of(rig, [recorded([u, y[0]], RATE, 0.002)], KNOWN)
    assert named(found) == ["guide_friction"]
    assert found.mechanisms[0].parameters["friction_force_n"].value == pytest.approx(8, rel=0.06)


@pytest.mark.slow
def test_a_base_that_shakes_and_drag_seen_by_acceleration(u: Real) -> None:
    def rest(s: float, x: Real, v: Real) -> Real:
        return -5 * s - OMEGA**2 * x - 0.01 * OMEGA * v - 3 * v * np.abs(v)

    y = motion(rest, [0.0, 0.0], SAMPLES, RATE, u)
    acceleration = rest(u, y[0], y[1])
    rig = parse_rig(SPRING + "inputs: [{channel: 0, base_acceleration: true, gain: 5}]\n" + sensor("acceleration"))
    found = answer_of(rig, [recorded([u, acceleration], RATE, 0.01)], KNOWN)
    assert named(found) == ["quadratic_damping"]
    assert found.mechanisms[0].parameters["quadratic_damping_n_s2_per_m2"].value == pytest.approx(3, rel=0.02)


@pytest.mark.slow
def test_a_pendulum_with_drag_is_named_by_its_sine_and_its_drag_and_time_is_not_ruled_out() -> None:
    y = motion(lambda s, x, v: -36 * np.sin(x) - 0.02 * v - 0.03 * v * np.abs(v), [0.35, 0.0], SAMPLES, 50.0)
    found = answer_of(parse_rig(PENDULUM), [recorded([y[0]], 50.0, 0.003)], KNOWN)
    assert named(found) == ["tube_spring_cubic", "quadratic_damping"]
    assert found.mechanisms[0].parameters["cubic_stiffness_n_per_m3"].value == pytest.approx(-6, rel=0.03)
    assert found.mechanisms[1].parameters["quadratic_damping_n_s2_per_m2"].value == pytest.approx(0.03, rel=0.1)
    assert "contact_creep" in found.mechanisms[0].indistinguishable_from
    assert "amplitude and time" in found.mechanisms[0].statement
    assert found.next_experiment is not None
    assert "different strength" in found.next_experiment.why
    (time,) = (r for r in found.rivals if r.ids == ("contact_creep",))
    ratio = re.search(r"is (\S+) times that of tube spring cubic alone(; amplitude and time go together)?", time.why)
    assert ratio is not None
    assert (float(ratio[1]) < 1) == (ratio[2] is not None)  # who has the smaller error is told why it lost


@pytest.mark.long
def test_a_stiffness_that_settles_with_time_is_named_as_such() -> None:
    omega = 2 * np.pi * 30
    t = np.arange(3000) / 300.0

    def rest(z_t: float, x: Real, v: Real) -> Real:
        return -(omega**2) * (1 + 0.01 * (1 - np.exp(-z_t / 4))) * x - 0.002 * omega * v

    y = motion(rest, [0.01, 0.0], t.size, 300.0, t)  # the "input" is the time itself
    found = answer_of(parse_rig(JOINT), [recorded([y[0]], 300.0, 0.003)], KNOWN)
    assert named(found) == ["contact_creep"]
    assert found.mechanisms[0].parameters["settling_time_s"].value == pytest.approx(4, rel=0.1)


@pytest.mark.parametrize("stiffness", [1e-12, 5.0, 15.79, 157_910.0])
def test_a_rig_described_far_from_the_one_recorded_is_not_consistent(stiffness: float) -> None:
    t = np.arange(3000) / 1000
    decay = np.exp(-1.5 * t) * np.sin(2 * np.pi * 20 * t)  # of 1 kg on 15,791 N/m
    rig = parse_rig(SPRING.replace("damping: unknown", f"stiffness: {stiffness}") + sensor("displacement", 0))
    found = answer_of(rig, [recorded([decay], 1000.0, 3e-4)], KNOWN)
    assert found.verdict == "unexplained"
    assert found.far_off
    assert found.location is not None
    assert "most of the motion" in found.location.why
    assert found.mechanisms == ()


@pytest.mark.long
def test_a_gain_of_many_decades_overflows_nothing() -> None:
    t = np.arange(3000) / 1000
    decay = np.exp(-1.5 * t) * np.sin(2 * np.pi * 20 * t)
    rig = parse_rig(SPRING.replace(", damping: unknown", "") + sensor("displacement, gain: 1.0e+20", 0))
    found = answer_of(rig, [recorded([decay], 1000.0, 3e-4)], variants(catalogue()))
    assert np.isfinite(found.fit.heldout_rms_before)  # a warning of numpy's is an error in tests


@pytest.mark.long
def test_wrong_constants_under_a_measured_force_are_not_consistent(u: Real) -> None:
    y = motion(lambda s, x, v: 100 * s - OMEGA**2 * x - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u)
    rig = parse_rig(
        SPRING.replace("damping", f"stiffness: {1e-3 * OMEGA**2}, damping") + INPUT + sensor("displacement")
    )
    found = answer_of(rig, [recorded([u, y[0]], RATE, 1e-3)], KNOWN)
    assert (found.verdict, found.far_off) == ("unexplained", True)


@pytest.mark.long
@pytest.mark.parametrize("pole", [0.0, 0.9, 0.99])
def test_strong_noise_does_not_make_a_sound_rig_far_off(u: Real, pole: float) -> None:
    y = motion(lambda s, x, v: 100 * s - OMEGA**2 * x - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u)[0]
    noise = lfilter([1], [1, -pole], np.random.default_rng(6).normal(size=SAMPLES))
    rig = parse_rig(SPRING + INPUT + sensor("displacement"))
    found = answer_of(rig, [recorded([u, y + y.std() * noise / noise.std()], RATE, 0.0)], KNOWN)
    assert found.verdict == "consistent"
    assert not found.far_off


@pytest.mark.long
def test_a_part_that_resonates_between_the_modes_of_two_bodies_is_named() -> None:
    known = [m for m in variants(catalogue()) if m.id in (*SHORT, "attached_mass", "frame_compliance", "channel_skew")]
    mass = np.array([1.0, 0.6, 0.02])  # the part rides on the first, at 16 Hz between 11 and 23 Hz
    k = np.array([[18e3, -8e3, 0], [-8e3, 8e3, 0], [0, 0, 0]])
    c = np.array([[1.3, -0.5, 0], [-0.5, 0.5, 0], [0, 0, 0]])
    for matrix, value in ((k, 202.0), (c, 0.08)):
        matrix[np.ix_([0, 2], [0, 2])] += value * np.array([[1, -1], [-1, 1]])
    recordings = []
    for seed, loud in ((1, 1.0), (2, 0.35)):
        start = [loud * v for v in (1e-3, -1.5e-3, 1e-3, 0.25, 0.12, 0.0)]
        z = motion(lambda s, x, v: -(c @ v + k @ x) / mass, start, 1600, 400.0)
        noise = np.random.default_rng(seed).normal(size=(2, 1600)) * 3e-3 * z[3:5].std(axis=1, keepdims=True)
        recordings.append(Recording(z[3:5] + noise, 400.0, ("a", "b"), "", "made"))
    rig = parse_rig("""
bodies: {one: 1.0, two: 0.6}
joints: [{name: lower, between: [one, ground]}, {name: upper, between: [two, one]}]
sensors: [{channel: a, of: one, shows: velocity}, {channel: b, of: two, shows: velocity}]
""")
    found = answer_of(rig, recordings, known)
    assert named(found) == ["attached_mass"]
    part = found.mechanisms[0].parameters
    assert part["attached_mass_kg"].value == pytest.approx(0.02, rel=0.1)
    assert part["mount_frequency_hz"].value == pytest.approx(16.0, rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize(("share", "seed"), [(0.02, 2), (0.0, 3)])
def test_a_second_impact_on_one_of_two_bodies_is_named_with_its_size(share: float, seed: int) -> None:
    known = [m for m in variants(catalogue()) if m.id in (*SHORT, "attached_mass", "double_hit")]
    mass, rate = np.array([1.0, 0.6]), 400.0
    k, c = np.array([[18e3, -8e3], [-8e3, 8e3]]), np.array([[1.3, -0.5], [-0.5, 0.5]])
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-k / mass[:, None], -c / mass[:, None]]])
    recordings, random = [], np.random.default_rng(seed)
    for loud, when in ((1.0, 0.231), (0.4, 1.337)):  # s
        start = np.array([0.0, 0.0, 0.0, loud])
        t = np.arange(1600) / rate
        y = _decay(a, start, t)[2:] + (t > when) * _decay(a, share * start, np.maximum(t - when, 0.0))[2:]
        noise = 3e-3 * random.normal(size=y.shape) * y.std(axis=1, keepdims=True)
        recordings.append(Recording(y + noise, rate, ("a", "b"), "", "made"))
    rig = parse_rig("""
bodies: {one: 1.0, two: 0.6}
joints: [{name: lower, between: [one, ground]}, {name: upper, between: [two, one]}]
sensors: [{channel: a, of: one, shows: velocity}, {channel: b, of: two, shows: velocity}]
""")
    found = answer_of(rig, recordings, known)
    assert named(found) == (["double_hit"] if share else [])
    if share:
        size = found.mechanisms[0].parameters["second_impulse_fraction"]
        assert found.mechanisms[0].element == "two"
        said = "struck 'two' after 0.231 s in recording 1 (2 %), 1.337 s in recording 2 (2 %)"
        assert said in found.mechanisms[0].statement
        assert size.value == pytest.approx(share, rel=0.05)
        assert size.low < share < size.high
    else:
        limits = {limit.id: limit.value for limit in found.upper_limits}
        assert limits["double_hit"] < 0.02


@pytest.mark.long
@pytest.mark.parametrize("when", [0.2721, 0.345])  # s; the second in a held-out stretch
def test_a_second_impact_after_silence_has_its_size(when: float) -> None:
    known = [m for m in variants(catalogue()) if m.id in ("tube_spring_cubic", "double_hit")]
    mass, rate, share, begun = np.array([0.5, 0.3]), 1000.0, 0.05, 0.02
    k, c = np.array([[9e4, -3e4], [-3e4, 3e4]]), np.array([[1.7, -0.5], [-0.5, 0.5]])
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-k / mass[:, None], -c / mass[:, None]]])
    first, second = np.array([0, 0, 1.0, 0]), np.array([0, 0, 0, share * np.sqrt(mass[0] / mass[1])])
    t = np.arange(1000) / rate
    y = sum((t > at) * _decay(a, z, np.maximum(t - at, 0.0))[:2] for at, z in ((begun, first), (when, second)))
    y = y + 3e-3 * np.random.default_rng(5).normal(size=y.shape) * y.std(axis=1, keepdims=True)
    rig = parse_rig("""
bodies: {one: 0.5, two: 0.3}
joints: [{name: lower, between: [one, ground]}, {name: upper, between: [two, one]}]
sensors: [{channel: a, of: one, shows: displacement}, {channel: b, of: two, shows: displacement}]
""")
    found = answer_of(rig, [Recording(y, rate, ("a", "b"), "", "made")], known)
    assert named(found) == ["double_hit"]
    size = found.mechanisms[0].parameters["second_impulse_fraction"]
    assert size.low < share < size.high


@pytest.mark.slow
def test_a_second_impact_in_one_of_two_decays_has_the_size_that_it_has_there() -> None:
    known = [m for m in variants(catalogue()) if m.id in ("tube_spring_cubic", "double_hit")]
    a, t, random = np.array([[0.0, 1.0], [-(OMEGA**2), -1.0]]), np.arange(1600) / 400.0, np.random.default_rng(6)
    recordings = []
    for loud, share in ((1.0, 0.0), (0.5, 0.15)):
        y = _decay(a, np.array([0.0, loud]), t)[1]
        y += (t > 0.8117) * _decay(a, np.array([0.0, share * loud]), np.maximum(t - 0.8117, 0.0))[1]
        recordings.append(Recording((y + 2e-3 * loud * random.normal(size=y.size))[None], 400.0, ("a",), "", "made"))
    rig = parse_rig(
        "bodies: {mass: 1}\njoints: [{between: [mass, ground]}]\nsensors: [{channel: a, of: mass, shows: velocity}]\n"
    )
    found = answer_of(rig, recordings, known)
    assert named(found) == ["double_hit"]
    assert found.mechanisms[0].parameters["second_impulse_fraction"].value == pytest.approx(0.15, rel=0.02)
    assert "recording 2" in found.mechanisms[0].statement
    assert "recording 1" not in found.mechanisms[0].statement


@pytest.mark.long
def test_where_there_were_three_impacts_one_is_named_once_and_the_rest_is_left_over() -> None:
    known = [m for m in variants(catalogue()) if m.id in ("tube_spring_cubic", "double_hit")]
    a, t = np.array([[0.0, 1.0], [-(OMEGA**2), -1.0]]), np.arange(1600) / 400.0
    y = _decay(a, np.array([0.0, 1.0]), t)[1]
    for share, when in ((0.3, 0.4312), (0.2, 1.7779)):
        y += (t > when) * _decay(a, np.array([0.0, share]), np.maximum(t - when, 0.0))[1]
    y += 2e-3 * np.random.default_rng(4).normal(size=y.size)
    rig = parse_rig(
        "bodies: {mass: 1}\njoints: [{between: [mass, ground]}]\nsensors: [{channel: a, of: mass, shows: velocity}]\n"
    )
    found = answer_of(rig, [Recording(y[None], 400.0, ("a",), "", "made")], known)
    assert found.verdict != "consistent"
    assert named(found).count("double_hit") <= 1
    assert found.remainder.p_value < 0.01


def _decay(a: Real, start: Real, t: Real) -> Real:
    """Return (states, n) of ``z' = a z`` by its eigenvectors."""
    values, vectors = np.linalg.eig(a)
    return np.asarray((vectors * np.linalg.solve(vectors, start)) @ np.exp(np.outer(values, t)), complex).real


@pytest.mark.slow
def test_of_a_spring_and_a_pendulum_it_is_the_pendulum_that_is_bent() -> None:
    known = [catalogue()[name][-1] for name in (*SHORT, "end_stop", "spring_asymmetry", "attached_mass")]
    u = np.repeat([0.0, 5e-4, -4e-4, 3e-4], 500)

    def rest(s: float, x: Real, v: Real) -> Real:
        pendulum, spring = 333 * x[0] + 0.46 * v[0] + 1.1e11 * x[0] ** 3, 348 * (x[1] - x[0]) + 0.7 * (v[1] - v[0])
        return np.array([(spring - pendulum) / 0.75, (s - spring) / 1.2])

    z, at = [], np.zeros(4)
    for level in u[::500]:  # held between steps, which a spline would ring at
        z.append(motion(lambda s, x, v, push=level: rest(push, x, v), list(at), 501, 135.0))
        at = z[-1][:, -1]
    x, v = np.split(np.hstack([part[:, :-1] for part in z]), 2)
    rows = [u, np.array([rest(s, *pair)[0] for s, *pair in zip(u, x.T, v.T, strict=True)])]
    rig = parse_rig("""
bodies: {one: 0.75, two: 1.2}
pendulums: [{between: [one, ground]}]
springs: [{between: [two, one], damping: unknown}]
inputs: [{channel: 0, force_on: two}]
recording: {hold: zero}
sensors: [{channel: 1, of: one, shows: acceleration}]
""")
    found = answer_of(rig, [recorded(rows, 135.0, 1e-3)], known)
    assert named(found) == ["tube_spring_cubic"]
    assert found.mechanisms[0].parameters["cubic_stiffness_n_per_m3"].value == pytest.approx(1.1e11, rel=0.1)
