"""Eq. 9 with mechanisms in it, against the exact solution, scipy's DOP853 and closed forms."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from rig.errors import RigError
from rig.settings import Filter, RigSettings
from rig.tube import OwnMode
from sim_backend.adopted import adopted
from sim_backend.mechanisms.catalogue import catalogue, variants
from sim_backend.pulses import half_sine
from sim_backend.rig import SimulatedRig
from sim_backend.ring_down import ring_down_linear
from sim_backend.settings import SimBackendSettings
from sim_backend.twin import twin_record
from tests.analysis.ring_downs import FILTER, ONSET_S, RATE_HZ, analog_filter, pulse_of, two_mass

NONE = Filter(family="none")
LOAD_N, SAMPLES = 0.4, 1500
ONSET = ONSET_S + 1.3e-5  # between two samples
RIG = two_mass(LOAD_N)
ANALOG = analog_filter(FILTER)


def twin(*found, ratio: float = 0.9, rig=RIG):
    return twin_record(rig, LOAD_N, found, pulse_of(RIG, LOAD_N, ratio), ONSET, SAMPLES, RATE_HZ, ANALOG)


def share(off: np.ndarray, whole: np.ndarray) -> float:
    return float(np.abs(off).max() / np.abs(whole).max())


def test_without_mechanisms_it_is_the_exact_solution() -> None:
    acceleration, lower = twin()
    exact = ring_down_linear(RIG, pulse_of(RIG, LOAD_N, 0.9), ONSET, SAMPLES, RATE_HZ, ANALOG)
    assert share(acceleration - exact.acceleration, exact.acceleration) < 1e-9
    assert share(lower - exact.lower_displacement, exact.lower_displacement) < 1e-9


def test_a_declared_mode_of_the_tube_springs_is_in_it_too() -> None:
    rig = replace(RIG, tube_mode=OwnMode(0.0013, 6078.0))
    acceleration, lower = twin(rig=rig)
    exact = ring_down_linear(rig, pulse_of(RIG, LOAD_N, 0.9), ONSET, SAMPLES, RATE_HZ, ANALOG)
    assert share(acceleration - exact.acceleration, exact.acceleration) < 1e-9
    assert share(lower - exact.lower_displacement, exact.lower_displacement) < 1e-9
    without, _ = twin()
    assert share(acceleration - without, without) > 1e-3


def contact_force(mechanism: str, d: float, rate: float) -> float:
    """Dynamic force of the contact, written as in the literature."""
    linear, viscous = RIG.kc * d, RIG.cc * rate
    if mechanism == "hertz_stiffness":
        return LOAD_N * max(1 + RIG.kc * d / (1.5 * LOAD_N), 0.0) ** 1.5 - LOAD_N + viscous
    if mechanism == "rough_surface_stiffness":
        return LOAD_N * np.expm1(linear / LOAD_N) + viscous
    return max(linear + viscous, -LOAD_N)


def lower_displacement(mechanism: str, ratio: float) -> np.ndarray:
    """x2 after a tap, by scipy's DOP853 from knot to knot."""
    pulse = pulse_of(RIG, LOAD_N, ratio)

    def slope(t: float, z: np.ndarray) -> list[float]:
        force = contact_force(mechanism, z[0] - z[1], z[2] - z[3])
        tap = float(pulse(t - ONSET))
        return [z[2], z[3], (tap - force - RIG.k1 * z[0]) / RIG.m1, (force - RIG.k2 * z[1]) / RIG.m2]

    times, z, out = np.arange(SAMPLES) / RATE_HZ, np.zeros(4), np.zeros(SAMPLES)
    knots = [*(pulse.knots + ONSET), times[-1] + 1e-9]
    for left, right in pairwise(knots):
        found = solve_ivp(
            slope, (left, right), z, "DOP853", rtol=1e-12, atol=1e-16, max_step=0.5 / RATE_HZ, dense_output=True
        )
        inside = (times >= left) & (times <= right)
        out[inside] = found.sol(times[inside])[1] if inside.any() else out[inside]
        z = found.y[:, -1]
    return out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mechanism", "ratio", "bound"),
    [("hertz_stiffness", 0.9, 1e-6), ("rough_surface_stiffness", 0.9, 3e-6), ("contact_loss", 1.3, 1e-5)],
)
def test_a_tap_on_a_force_law_is_what_scipy_gives(mechanism: str, ratio: float, bound: float) -> None:
    _, lower = twin(adopted(mechanism, {}), ratio=ratio)
    true = lower_displacement(mechanism, ratio)
    linear = ring_down_linear(RIG, pulse_of(RIG, LOAD_N, ratio), ONSET, SAMPLES, RATE_HZ, ANALOG)
    assert share(lower - true, true) < bound
    assert share(linear.lower_displacement - true, true) > 1e-3


def test_mechanisms_too_stiff_to_compute_are_told() -> None:
    with pytest.raises(RigError, match="could not be computed"):
        twin(adopted("quadratic_damping", {"quadratic_damping_per_c_c": 1e9}), ratio=1e6)


def test_dampers_of_the_tube_springs_are_those_of_eq_9_with_dampers() -> None:
    acceleration, _ = twin(adopted("tube_spring_damping", {"c_n_s_per_m": 3.0}))
    damped = replace(RIG, c1=3.0, c2=3.0)
    exact = ring_down_linear(damped, pulse_of(RIG, LOAD_N, 0.9), ONSET, SAMPLES, RATE_HZ, ANALOG)
    assert share(acceleration[0] - exact.acceleration, exact.acceleration) < 1e-9
    both, _ = twin(adopted("tube_spring_damping", {"c_n_s_per_m": 1.0}), rig=replace(RIG, c1=2.0, c2=2.0))
    assert share(both - acceleration, acceleration) < 1e-9


def test_a_heavy_frame_that_does_not_move_changes_nothing() -> None:
    frame = {"frame_mass_kg": 9e4, "frame_stiffness_n_per_m": 9e10, "frame_damping_n_s_per_m": 1e3}
    acceleration, _ = twin(adopted("frame_compliance", frame))
    assert share(acceleration - twin()[0], acceleration) < 1e-4


def test_the_sensor_chain_distorts_what_the_rig_does() -> None:
    a, b = twin(adopted("channel_gain", {"gain_error_of_b": 0.02}))[0]
    assert np.allclose(b, 1.02 * a, rtol=1e-12)


@pytest.mark.parametrize(
    ("mechanism", "parameters", "sentence"),
    [
        ("magnetism", {}, "unknown mechanism 'magnetism'"),
        ("load_drift", {"gauge_drift_mv": 1.0}, "load_drift does not act in a ring-down"),
        ("channel_gain", {}, "channel_gain needs gain_error_of_b"),
        ("channel_gain", {"gain_error_of_b": 0.1, "colour": 1.0}, "channel_gain has no parameter 'colour'"),
        ("channel_gain", {"gain_error_of_b": 50.0}, "gain_error_of_b is 50, allowed are -0.9 to 9"),
    ],
)
def test_a_mechanism_that_cannot_be_is_refused_in_a_sentence(mechanism, parameters, sentence) -> None:
    with pytest.raises(ValidationError, match=sentence):
        SimBackendSettings.model_validate({"mechanisms": [{"id": mechanism, "parameters": parameters}]})


@pytest.mark.parametrize(
    ("contact", "sentence"),
    [
        ({"law": "hertz"}, r"write mechanisms: \[\{id: hertz_stiffness\}\] in section sim_backend"),
        ({"law": "exponential", "can_part": True}, r"\[\{id: rough_surface_stiffness\}, \{id: contact_loss\}\]"),
        ({"law": "cubic"}, "leave them out, and the contact is linear"),
    ],
)
def test_a_force_law_of_the_contact_is_a_mechanism(contact, sentence) -> None:
    with pytest.raises(ValidationError, match=sentence):
        SimBackendSettings.model_validate({"contact": contact})


def test_the_linear_law_of_older_configurations_is_what_it_was() -> None:
    older = SimBackendSettings.model_validate({"contact": {"law": "linear", "can_part": False}})
    assert older == SimBackendSettings()


def quiet_rig(*mechanisms: dict) -> SimulatedRig:
    settings = SimBackendSettings.model_validate({"mechanisms": list(mechanisms)})
    return SimulatedRig(RigSettings(springs={"system_resonance_hz": 356.0}), settings)


def first_block(rig: SimulatedRig) -> np.ndarray:
    rig.accelerometers.start()
    return rig.accelerometers.read_block().acceleration


def test_the_mains_hums_in_both_channels_also_before_a_tap() -> None:
    hum = {"id": "mains_hum", "parameters": {"amplitude_m_s2": 0.3, "mains_hz": 60.0, "lines": 1.0}}
    tone = first_block(quiet_rig(hum)) - first_block(quiet_rig())
    step = 2 * np.pi * 60.0 / 25000.0
    # a sine: twice the middle value times the cosine of the step is the sum of its neighbours
    assert np.allclose(tone[:, 2:] + tone[:, :-2], 2 * np.cos(step) * tone[:, 1:-1], atol=5e-3)
    assert 0.25 < np.abs(tone).max() < 0.31


def test_what_follows_from_a_parameter_may_stand_beside_it() -> None:
    derived = [(m, d) for m in variants(catalogue()) for d in m.derived]
    for mechanism, more in derived:
        name, quantities = mechanism.id, mechanism.parameters
        values = {q.name: (q.low * q.high) ** 0.5 if q.log and q.low > 0 else q.high / 2 for q in quantities}
        assert adopted(name, values | {more.name: more.value(values)}).values == adopted(name, values).values


def test_every_tap_is_followed_by_the_second_impact() -> None:
    rig = quiet_rig({"id": "double_hit", "parameters": {"second_impulse_fraction": 0.05}})
    for _ in range(5):
        rig.impactor.tap(0.0)
    good = [t for t in rig.impactor.history if "double" not in t.kinds]
    assert good
    assert all(t.peaks_n[1] == pytest.approx(0.05 * t.peaks_n[0]) for t in good)
    assert half_sine(1.0, 3e-4).duration_s <= min(t.delays_s[1] for t in good)


def in_the_twin(name: str, **values: float) -> tuple[np.ndarray, np.ndarray]:
    return twin_record(
        RIG, LOAD_N, [adopted(name, values)], pulse_of(RIG, LOAD_N, 0.5), ONSET, SAMPLES, RATE_HZ, analog_filter(NONE)
    )


def test_strain_of_its_base_adds_the_contacts_force_to_one_channel() -> None:
    (a, b), lower = in_the_twin("base_strain", base_strain_m_s2_per_n=0.03)
    force = RIG.m2 * a + RIG.k2 * lower  # by Newton's law; A is not strained
    assert share(b - a - 0.03 * force, force) < 1e-9


def test_motion_across_the_axis_shows_in_one_channel() -> None:
    omega, mass = 2 * np.pi * 3000.0, 0.1
    lateral = {"lateral_stiffness_n_per_m": mass * omega**2, "lateral_damping_n_s_per_m": 2.0}
    (a, b), lower = in_the_twin("cross_axis_sensitivity", cross_axis_share=1e-3, lateral_mass_kg=mass, **lateral)
    seen = np.abs(np.fft.rfft(a[600:] - b[600:]))[1:]
    assert np.argmax(seen) + 1 == pytest.approx(3000.0 * seen.size * 2 / RATE_HZ, abs=2)
    below = in_the_twin("cross_axis_sensitivity", cross_axis_share=1e-3, lateral_mass_kg=mass, **lateral)[1]
    np.testing.assert_array_equal(lower, below)
    force = RIG.m2 * b + RIG.k2 * lower
    assert share(a - b, force / mass) < 0.05  # a thousandth of what the force would give the mass, amplified


SERIES = {"specimen_mass_kg": 1e-5, "holder_stiffness_n_per_m": 4e7, "holder_damping_n_s_per_m": 1e-3}


def test_a_holder_in_series_is_a_softer_contact() -> None:
    """A specimen that weighs next to nothing on a holder: 1/k = 1/k_c + 1/k_h in the place of k_c."""
    held = in_the_twin("holder_compliance", **SERIES)[0][0]
    softer = replace(RIG, kc=1 / (1 / RIG.kc + 1 / SERIES["holder_stiffness_n_per_m"]))
    softer = replace(softer, cc=RIG.cc * (softer.kc / RIG.kc) ** 2)
    exact = ring_down_linear(softer, pulse_of(RIG, LOAD_N, 0.5), ONSET, SAMPLES, RATE_HZ, analog_filter(NONE))
    assert share(held - exact.acceleration, held) < 0.03
    plain = ring_down_linear(RIG, pulse_of(RIG, LOAD_N, 0.5), ONSET, SAMPLES, RATE_HZ, analog_filter(NONE))
    assert share(held - plain.acceleration, held) > 0.5


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("air_film", {"film_side_m": 1.35e-3, "film_gap_m": 5e-7}),
        ("contact_relaxation", {"relaxing_share": 0.2, "relaxation_time_s": 1e-4}),
        ("plastic_loading", {"yielding_share": 0.5}),
        ("cable_drag", {"cable_damping_n_s_per_m": 2.0}),
        ("sampling_jitter", {"jitter_samples": 0.01}),
        ("converter_step", {"step_m_s2": 0.01, "rounded_share": 0.01}),
    ],
)
def test_what_a_free_decay_hides_can_be_simulated(name: str, values: dict[str, float]) -> None:
    found = in_the_twin(name, **values)[0]
    plain = ring_down_linear(RIG, pulse_of(RIG, LOAD_N, 0.5), ONSET, SAMPLES, RATE_HZ, analog_filter(NONE)).acceleration
    assert np.all(np.isfinite(found))
    assert 1e-4 < share(found - plain, plain) < 2.0
