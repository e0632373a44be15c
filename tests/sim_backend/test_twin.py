"""Eq. 9 with mechanisms in it, against the exact solution, the integrator and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from rig.settings import RigSettings
from sim_backend.adopted import adopted
from sim_backend.contact_laws import ContactLaw
from sim_backend.integrator import ring_down
from sim_backend.mechanisms.mechanism import mechanisms
from sim_backend.pulses import half_sine
from sim_backend.rig import SimulatedRig
from sim_backend.ring_down import ring_down_linear
from sim_backend.settings import SimBackendSettings
from sim_backend.twin import twin_record
from tests.analysis.ring_downs import FILTER, ONSET_S, RATE_HZ, analog_filter, pulse_of, two_mass

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
    assert share(acceleration - exact.acceleration, exact.acceleration) < 2e-4
    assert share(lower - exact.lower_displacement, exact.lower_displacement) < 2e-4


@pytest.mark.parametrize(
    ("mechanism", "law", "can_part", "ratio"),
    [
        ("hertz_stiffness", "hertz", False, 0.9),
        ("rough_surface_stiffness", "exponential", False, 0.9),
        ("contact_loss", "linear", True, 1.3),
    ],
)
def test_a_force_law_gives_what_the_integrator_gives(mechanism: str, law: str, can_part: bool, ratio: float) -> None:
    acceleration, _ = twin(adopted(mechanism, {}), ratio=ratio)
    pulse = pulse_of(RIG, LOAD_N, ratio)
    true = ring_down(RIG, ContactLaw(law, LOAD_N, can_part), pulse, ONSET, SAMPLES, RATE_HZ, ANALOG)  # type: ignore[arg-type]
    linear = ring_down_linear(RIG, pulse, ONSET, SAMPLES, RATE_HZ, ANALOG)
    assert share(acceleration[0] - true.acceleration, true.acceleration) < 1e-3
    assert share(linear.acceleration - true.acceleration, true.acceleration) > 0.02


def test_dampers_of_the_tube_springs_are_those_of_eq_9_with_dampers() -> None:
    acceleration, _ = twin(adopted("tube_spring_damping", {"c_n_s_per_m": 3.0}))
    damped = replace(RIG, c1=3.0, c2=3.0)
    exact = ring_down_linear(damped, pulse_of(RIG, LOAD_N, 0.9), ONSET, SAMPLES, RATE_HZ, ANALOG)
    assert share(acceleration[0] - exact.acceleration, exact.acceleration) < 2e-4
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
        ("magnetism", {}, "'magnetism' is no mechanism"),
        ("load_drift", {"gauge_drift_mv": 1.0}, "load_drift does not act in a ring-down"),
        ("channel_gain", {}, "channel_gain needs gain_error_of_b"),
        ("channel_gain", {"gain_error_of_b": 0.1, "colour": 1.0}, "channel_gain has no parameter 'colour'"),
        ("channel_gain", {"gain_error_of_b": 50.0}, "gain_error_of_b is 50, allowed are -0.9 to 9"),
    ],
)
def test_a_mechanism_that_cannot_be_is_refused_in_a_sentence(mechanism, parameters, sentence) -> None:
    with pytest.raises(ValidationError, match=sentence):
        SimBackendSettings.model_validate({"mechanisms": [{"id": mechanism, "parameters": parameters}]})


def test_mechanisms_need_a_linear_contact_to_act_on() -> None:
    with pytest.raises(ValidationError, match="mechanisms act on a linear contact"):
        SimBackendSettings.model_validate({"contact": {"law": "hertz"}, "mechanisms": [{"id": "contact_loss"}]})


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
    derived = [(m.id, d) for m in mechanisms().values() for d in m.derived]
    for name, more in derived:
        quantities = mechanisms()[name].parameters
        values = {q.name: (q.low * q.high) ** 0.5 if q.log and q.low > 0 else q.high / 2 for q in quantities}
        assert adopted(name, values | {more.name: more.value(values)}).values == adopted(name, values).values


def test_every_tap_is_followed_by_the_second_blow() -> None:
    rig = quiet_rig({"id": "double_hit", "parameters": {"second_impulse_fraction": 0.05}})
    for _ in range(5):
        rig.impactor.strike(0.0)
    good = [t for t in rig.impactor.history if "double" not in t.kinds]
    assert good
    assert all(t.peaks_n[1] == pytest.approx(0.05 * t.peaks_n[0]) for t in good)
    assert half_sine(1.0, 3e-4).duration_s <= min(t.delays_s[1] for t in good)
