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
    extra = along(catalogue()["hertz_stiffness"][0].law, p[None], d, np.zeros(50), 0.0, 1e-5, np.zeros(MEMORY))[0]
    expected = preload * ((rest + d) / rest) ** 1.5 - preload - stiffness * d
    assert np.allclose(extra, expected, atol=1e-12)


def test_a_slider_dissipates_four_times_its_force_times_the_sliding_in_a_cycle() -> None:
    k, limit, reach = 1e5, 1e-3, 5e-8
    d = reach * np.sin(np.linspace(0, 4 * math.pi, 40001))
    mechanism = catalogue()["micro_slip"][0]
    p = np.array([0.1, 1e6, 0.0, 1e-6, k, limit, 1.0])
    force = along(mechanism.law, p[None], d, np.zeros(d.size), 0.0, 1e-6, np.zeros(MEMORY))[0] + k * d
    second = slice(20000, 40001)
    work = float(np.trapezoid(force[second], d[second]))
    assert work == pytest.approx(4 * limit * (reach - limit / k), rel=1e-3)


@pytest.mark.parametrize("speed", [-3e-4, -1e-5, 0.0, 1e-5, 3e-4])
def test_menisci_pull_as_the_surfaces_part_and_other_attraction_on_both_ways(speed: float) -> None:
    rest = AtRest(0.2, 2e6, 3.0)
    menisci = {"meniscus_force_share": 0.1, "meniscus_range_share": 0.5, "sets_in_m_per_s": 1e-4}
    d = np.linspace(-2e-7, 1e-7, 31)
    fading = np.exp(np.minimum(d, 0) / (0.5 * 0.2 / 2e6))
    expected = {
        "adhesion": ({"adhesion_force_share": 0.1, "adhesion_range_share": 0.5}, 0.02 * (1 - fading)),
        "menisci": (menisci, 0.01 * (1 - (1 - math.tanh(speed / 1e-4)) * fading)),
    }
    for name, (values, force) in expected.items():
        mechanism = catalogue()[name][0]
        p = np.array([0.2, 2e6, 3.0, 1e-5, *mechanism.constants(values, rest)])
        found = along(mechanism.law, p[None], d, np.full(31, speed), 0.0, 1e-5, np.zeros(MEMORY))[0]
        assert np.allclose(found, force, atol=1e-12)


def work_of(name: str, values: dict[str, float], speed: float) -> float:
    """What a law of the contact takes in the second of two cycles, over the largest force times the way."""
    mechanism = catalogue()[name][0]
    phase = np.linspace(0, 4 * math.pi, 4001)
    d, v = 1e-7 * np.sin(phase), speed * np.cos(phase)
    h = 1e-7 / speed * phase[1]
    p = np.array([0.2, 2e6, 3.0, h, *mechanism.constants(values, AtRest(0.2, 2e6, 3.0))])
    force = along(mechanism.law, p[None], d, v, 0.0, h, np.zeros(MEMORY))[0][2000:]
    return float(np.trapezoid(force, d[2000:]) / np.ptp(force) / 2e-7)


def test_attraction_gives_back_what_it_takes_and_menisci_do_not() -> None:
    assert abs(work_of("adhesion", {"adhesion_force_share": 0.1, "adhesion_range_share": 0.5}, 1e-3)) < 1e-6
    menisci = {"meniscus_force_share": 0.1, "meniscus_range_share": 0.5, "sets_in_m_per_s": 1e-4}
    assert work_of("menisci", menisci, 1e-3) > 0.3


def test_a_contact_that_has_yielded_is_elastic_and_its_rest_has_moved() -> None:
    mechanism = catalogue()["plastic_loading"][0]
    d = 1e-7 * np.sin(np.linspace(0, 4 * math.pi, 4001))
    p = np.array([0.2, 2e6, 3.0, 1e-6, *mechanism.constants({"yielding_share": 0.5}, AtRest(0.2, 2e6, 3.0))])
    force = along(mechanism.law, p[None], d, 0 * d, 0.0, 1e-6, np.zeros(MEMORY))[0]
    rising = slice(0, 501)
    np.testing.assert_allclose(force[rising], -0.5 * 2e6 * d[rising], atol=1e-12)
    np.testing.assert_allclose(force[501:], -0.5 * 2e6 * 1e-7, rtol=1e-6)


def squeezed(side: float, gap: float, omega: float) -> complex:
    """Stiffness of the air between square flats by finite differences of the linear Reynolds equation, N/m."""
    from scipy.sparse import diags, identity, kron
    from scipy.sparse.linalg import spsolve

    count, pressure, viscosity = 79, 101325.0, 1.83e-5
    step = side / (count + 1)
    line = diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(count, count)) / step**2
    leak = kron(line, identity(count)) + kron(identity(count), line)
    lag = 12j * omega * viscosity / (pressure * gap**2)
    raised = spsolve((lag * identity(count**2) - leak).tocsc(), np.full(count**2, lag, complex))
    return complex(pressure / gap * raised.sum() * step**2)


@pytest.mark.parametrize(("side", "gap", "hz"), [(1.35e-3, 1e-6, 1500.0), (1.35e-3, 3e-6, 1500.0), (5e-3, 2e-5, 900.0)])
def test_an_air_film_is_the_linear_reynolds_equation(side: float, gap: float, hz: float) -> None:
    mechanism = catalogue()["air_film"][0]
    values = {"film_side_m": side, "film_gap_m": gap, "pressure_pa": 101325.0, "viscosity_pa_s": 1.83e-5}
    omega, h = 2 * math.pi * hz, 1 / hz / 400
    p = np.array([0.2, 0.0, 0.0, h, *mechanism.constants(values, AtRest(0.2, 0.0, 0.0))])
    assert p.size <= 20
    t = h * np.arange(40 * 400 + 1)
    force = along(mechanism.law, p[None], np.sin(omega * t), omega * np.cos(omega * t), 0.0, h, np.zeros(MEMORY))[0]
    last = slice(-401, None)
    found = 2 / t[400] * np.trapezoid(force[last] * np.exp(-1j * omega * t[last]), dx=h) * 1j
    expected = squeezed(side, gap, omega)
    assert found.real == pytest.approx(expected.real, abs=0.02 * abs(expected))
    assert found.imag == pytest.approx(expected.imag, abs=0.02 * abs(expected))


def test_masing_hysteresis_dissipates_the_area_of_its_loop_and_softens_as_its_virgin_curve():
    micro_slip = catalogue()["micro_slip"][-1]
    softening, exponent = 3.0, 1.5
    angle = np.linspace(0, 6 * np.pi, 6001)
    d, v = np.cos(angle), -np.sin(angle)
    p = np.array([0.0, 0.0, 0.0, angle[1], softening, exponent, 1.0])
    force = along(micro_slip.law, p[None], d, v, 0.0, angle[1], np.zeros(MEMORY))[0]
    # area of a Masing loop whose virgin curve lacks s |d|^e: 4 s (e - 1) / (e + 1)
    last = slice(4000, 6001)
    area = np.trapezoid(force[last], d[last])
    assert area == pytest.approx(4 * softening * (exponent - 1) / (exponent + 1), rel=1e-3)
    assert force[np.argmax(angle >= 4 * np.pi)] == pytest.approx(-softening, rel=1e-6)
