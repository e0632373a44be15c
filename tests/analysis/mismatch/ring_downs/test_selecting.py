"""Selections of a session: constants of its own for every impact where these scatter, beneath a strong effect too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.adopted import adopted
from sim_backend.pulses import Pulse
from sim_backend.recorder import analog_filter
from sim_backend.twin import twin_record
from sim_backend.two_mass import TwoMass
from tests.analysis.ring_downs import FILTER, ONSET_S, RATE_HZ, SAMPLES, diagnosed, session_of, two_mass
from tests.analysis.terms import listed
from tests.analysis.unlisted import in_contact

FRICTION_N = 2e-3


@pytest.mark.long
def test_scatter_beneath_a_strong_effect_is_not_left_over() -> None:
    rng = np.random.default_rng(3)

    def record(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
        own = replace(rig, kc=rig.kc * (1 + 4e-4 * rng.standard_normal()))
        found = [adopted("guide_friction", {"friction_force_n": FRICTION_N})]
        return twin_record(own, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))[0]

    found = diagnosed([session_of(record, ratios=(0.3, 0.4, 0.5))], [listed("guide_friction")]).answer
    assert [m.id for m in found.mechanisms] == ["guide_friction"]
    force = found.mechanisms[0].parameters["friction_force_n"]
    assert force.low < FRICTION_N < force.high
    assert force.high - force.low < 0.01 * FRICTION_N


@pytest.mark.long
def test_a_second_law_beside_a_strong_one_is_named_however_much_work_the_first_was() -> None:
    growth = 1.0

    def force(d: float, v: float, load: float) -> float:
        rig = two_mass(load)
        pressed = max(1 + rig.kc * d / (1.5 * load), 0.0) ** 1.5
        return load * (pressed - 1) - rig.kc * d + rig.cc * growth * rig.kc * d / load * v

    session = session_of(in_contact(force), noise=0.002, ratios=(0.3, 0.6, 0.9))
    laws = ("hertz_stiffness", "hunt_crossley_damping", "rough_surface_stiffness", "squeeze_film", "tube_mode")
    found = diagnosed([session], [listed(name) for name in laws])
    named = {m.id: m.parameters for m in found.answer.mechanisms}
    assert set(named) == {"hertz_stiffness", "hunt_crossley_damping"}
    (interval,) = named["hunt_crossley_damping"].values()
    assert interval.low < growth < interval.high
    assert found.selection.left.p_value > 0.01


@pytest.mark.long
def test_a_small_part_beside_a_strong_law_is_named() -> None:
    mass, omega, damping_ratio = 5e-4, 2 * np.pi * 3000.0, 0.02
    values = (mass, mass * omega**2, 2 * damping_ratio * mass * omega)
    names = ("attached_mass_kg", "mount_stiffness_n_per_m", "mount_damping_n_s_per_m")
    part = replace(adopted("attached_mass", dict(zip(names, values, strict=True))), place=(1,))  # on the lower mass
    found = [adopted("hertz_stiffness", {}), part]

    def record(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
        return twin_record(rig, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))[0]

    session = session_of(record, noise=0.002, ratios=(0.3, 0.6, 0.9))
    laws = ("hertz_stiffness", "attached_mass", "rough_surface_stiffness", "squeeze_film", "tube_mode")
    answer = diagnosed([session], [listed(name) for name in laws]).answer
    assert {m.id for m in answer.mechanisms} == {"hertz_stiffness", "attached_mass"}
    named = next(m for m in answer.mechanisms if m.id == "attached_mass")
    assert (named.element, named.place) == ("lower mass", "lower mass")
    intervals = named.parameters
    for name, true in zip(names, values, strict=True):
        assert intervals[name].low < true < intervals[name].high, name


@pytest.mark.long
def test_springs_that_bend_as_much_as_they_are_stiff_are_named() -> None:
    cubic = 1e17  # N/m3, at the peaks 0.1 to 1.5 of the stiffness at rest
    found = [adopted("tube_spring_cubic", {"cubic_stiffness_n_per_m3": cubic})]

    def record(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
        return twin_record(rig, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))[0]

    session = session_of(record, noise=0.002, ratios=(0.3, 0.6, 0.9))
    laws = ("tube_spring_cubic", "hertz_stiffness", "end_stop", "squeeze_film", "attached_mass")
    diagnosis = diagnosed([session], [listed(name) for name in laws])
    (named,) = diagnosis.answer.mechanisms
    (interval,) = named.parameters.values()
    assert named.id == "tube_spring_cubic"
    assert interval.low < cubic < interval.high
    assert diagnosis.selection.left.p_value > 0.01


@pytest.mark.slow
def test_tubes_that_ring_are_told_from_a_part_on_one_mass_and_their_mass_is_right() -> None:
    mass, omega, damping_ratio = 1.5e-3, 2 * np.pi * 3200.0, 0.01
    values = (mass, mass * omega**2, 2 * damping_ratio * mass * omega)
    names = ("tube_mode_mass_kg", "tube_mode_stiffness_n_per_m", "tube_mode_damping_n_s_per_m")
    found = [adopted("tube_mode", dict(zip(names, values, strict=True)))]

    def record(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
        return twin_record(rig, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))[0]

    session = session_of(record, noise=5e-4, ratios=(0.3, 0.6, 0.9))
    (named,) = diagnosed([session], [listed("tube_mode"), listed("attached_mass")]).answer.mechanisms
    assert named.id == "tube_mode"
    interval = named.parameters["tube_mode_mass_kg"]
    assert interval.low < mass < interval.high < 1.5 * interval.low
