"""Force laws along given motions, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_backend.force_law import MEMORY, along
from sim_backend.mechanisms.catalogue import catalogue
from sim_backend.mechanisms.kinds import AtRest


def test_the_hertz_law_is_the_power_of_three_halves_about_the_preload() -> None:
    preload, stiffness = 0.3, 2e6
    rest = 1.5 * preload / stiffness
    d = np.linspace(-0.9, 2, 50) * rest
    p = np.array([preload, stiffness, 0.0, 1e-5])
    extra = along(catalogue()["hertz_stiffness"][0].law, p, d, np.zeros(50), 0.0, 1e-5, np.zeros(MEMORY))
    expected = preload * ((rest + d) / rest) ** 1.5 - preload - stiffness * d
    assert np.allclose(extra, expected, atol=1e-12)


def test_a_slider_dissipates_four_times_its_force_times_the_sliding_in_a_cycle() -> None:
    k, limit, reach = 1e5, 1e-3, 5e-8
    d = reach * np.sin(np.linspace(0, 4 * math.pi, 40001))
    mechanism = catalogue()["micro_slip"][0]
    p = np.array([0.1, 1e6, 0.0, 1e-6, k, limit, 1.0])
    force = along(mechanism.law, p, d, np.zeros(d.size), 0.0, 1e-6, np.zeros(MEMORY)) + k * d
    second = slice(20000, 40001)
    work = float(np.trapezoid(force[second], d[second]))
    assert work == pytest.approx(4 * limit * (reach - limit / k), rel=1e-3)


@pytest.mark.parametrize("speed", [-3e-4, -1e-5, 0.0, 1e-5, 3e-4])
def test_menisci_pull_as_the_surfaces_part_and_other_attraction_on_both_ways(speed: float) -> None:
    adhesion = catalogue()["adhesion"][0]
    rest = AtRest(0.2, 2e6, 3.0)
    values = {"adhesion_force_share": 0.1, "adhesion_range_share": 0.5, "sets_in_m_per_s": 1e-4}
    d = np.linspace(-2e-7, 1e-7, 31)
    fading = np.exp(np.minimum(d, 0) / (0.5 * 0.2 / 2e6))
    expected = {0.0: 0.02 * (1 - fading), 1.0: 0.01 * (1 - (1 - math.tanh(speed / 1e-4)) * fading)}
    for menisci, force in expected.items():
        p = np.array([0.2, 2e6, 3.0, 1e-5, *adhesion.constants(values | {"menisci": menisci}, rest)])
        found = along(adhesion.law, p, d, np.full(31, speed), 0.0, 1e-5, np.zeros(MEMORY))
        assert np.allclose(found, force, atol=1e-12)


def test_masing_hysteresis_dissipates_the_area_of_its_loop_and_softens_as_its_virgin_curve():
    micro_slip = catalogue()["micro_slip"][-1]
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
