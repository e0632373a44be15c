"""The laws that are learned from, against closed forms and an independent integration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from sim_backend.arrays import Real
from sim_backend.force_law import MEMORY, along
from sim_backend.learned.families import FAMILIES, form_named, form_of, learned_mechanisms
from sim_backend.mechanisms.conformance import benches, effect, scaled
from sim_backend.mechanisms.kinds import AddedBody, AtRest, ForceLaw

D, V, P = 2e-8, 1e-4, 0.4  # references
REST = AtRest(preload=P, stiffness=8e6, damping=5.0)


def force(
    key: str, values: dict[str, float], d: np.ndarray, v: np.ndarray, load: float = P, h: float = 1e-5
) -> np.ndarray:
    form = form_named(key)
    law = form.loaded if load else form.mechanism
    assert isinstance(law, ForceLaw)
    at = {"reference_deflection_m": D, "reference_rate_m_per_s": V, "reference_load_n": P, "load_exponent": 0.0}
    packed = law.packed({**at, **values}, AtRest(load, 0.0, 0.0), h)
    return np.asarray(along(law.law, packed[None], d, v, 0.0, h, np.zeros(MEMORY))[0])


@given(st.floats(0.2, 6.0), st.floats(-3e-8, 3e-8))
def test_powers_of_the_deflection_are_odd_and_even(n: float, x: float) -> None:
    values = {"force_n": 0.02, "deflection_exponent": n, "rate_exponent": 0.0}
    d, v = np.array([x, -x]), np.zeros(2)
    odd = force("odd_power" if n > 1 else "odd_root", values, d, v)
    even = force("even_power", values, d, v)
    expected = 0.02 * (abs(x) / D) ** n
    assert even == pytest.approx([expected, expected])
    assert odd == pytest.approx([math.copysign(expected, x), math.copysign(expected, -x)])


@given(st.floats(-2.0, 2.0), st.floats(0.07, 1.0))
def test_a_force_goes_with_a_power_of_the_load(q: float, load: float) -> None:
    values = {"force_n": 0.02, "deflection_exponent": 2.0, "rate_exponent": 0.0, "load_exponent": q}
    found = force("even_power", values, np.array([D]), np.zeros(1), load)
    assert found[0] == pytest.approx(0.02 * (load / P) ** q)


def test_an_exponential_begins_as_a_square() -> None:
    d = np.linspace(-3, 3, 31) * D
    small = force("exponential", {"force_n": 0.02, "bend": 2e-3, "way": -1.0}, d, np.zeros(31))
    assert small == pytest.approx(0.02 * (d / D) ** 2, rel=5e-3, abs=1e-9)
    steep = force("exponential", {"force_n": 0.02, "bend": 1.5, "way": 1.0}, d, np.zeros(31))
    x = 1.5 * d / D
    assert steep == pytest.approx(2 * 0.02 * (np.exp(x) - 1 - x) / 1.5**2)


def test_a_power_of_the_approach_is_hertz_contact_with_three_halves_and_parts_where_the_load_is_gone() -> None:
    law = form_named("power_of_approach").loaded
    assert isinstance(law, ForceLaw)
    load, stiffness = 0.3, 7e6
    d = np.linspace(-1.5, 1.5, 41) * 1.5 * load / stiffness
    packed = law.packed({"deflection_exponent": 1.5}, AtRest(load, stiffness, 0.0), 1e-5)
    found = along(law.law, packed[None], d, np.zeros(41), 0.0, 1e-5, np.zeros(MEMORY))[0]
    approach = 1.5 * load / stiffness  # of a sphere under the load: F = load (1 + d / approach)^(3/2)
    whole = load * np.maximum(1 + d / approach, 0.0) ** 1.5 - load
    assert found == pytest.approx(whole - stiffness * d, abs=1e-12)


def test_nothing_acts_within_a_play() -> None:
    d = np.array([-2.0, -0.6, -0.4, 0.0, 0.4, 0.6, 2.0]) * D
    found = force("dead_zone", {"force_n": 0.02, "play": 0.5}, d, np.zeros(7))
    assert found == pytest.approx([-0.03, -0.002, 0, 0, 0, 0.002, 0.03], abs=1e-12)


def test_dry_friction_falls_with_the_rate_as_stribeck_says() -> None:
    v = np.array([-3.0, -0.3, 0.3, 3.0]) * V
    found = force("friction", {"force_n": 0.01, "falling_share": 1.0, "falling_rate": 0.5}, np.zeros(4), v)
    expected = [math.copysign(0.01 * (1 + math.exp(-((x / V / 0.5) ** 2))), x) for x in v]
    assert found == pytest.approx(expected)


@pytest.mark.parametrize(("n", "b"), [(1.0, 0.5), (2.0, 0.8), (1.5, 0.3)])
def test_hysteresis_is_that_of_bouc_and_wen(n: float, b: float) -> None:
    t = np.linspace(0, 0.01, 8001)
    d, v = 3e-8 * np.sin(1200 * t), 3e-8 * 1200 * np.cos(1200 * t)
    reach = 0.5
    values = {"force_n": 0.02, "reach": reach, "corner_exponent": n, "asymmetry": b}
    found = force("hysteresis", values, d, v, h=float(t[1]))

    def slope(s: float, z: Real) -> Real:
        rate = 3e-8 * 1200 * math.cos(1200 * s) / (reach * D)
        return np.array([rate * (1 - abs(z[0]) ** n * (1 - b + b * np.sign(z[0] * rate)))])

    z = solve_ivp(slope, (0, t[-1]), [0.0], "RK45", t, rtol=1e-9, atol=1e-12, max_step=1e-5).y[0]
    assert found == pytest.approx(0.02 * (z - d / (reach * D)), abs=2e-4 * 0.02)


def test_what_settles_and_what_lets_go_are_functions_of_time() -> None:
    d = np.full(1000, D)
    times = np.arange(1000) * 1e-5
    both = {"force_n": 0.02, "damping_force_n": 0.0, "time_s": 2e-3}
    assert force("settling", both, d, np.zeros(1000)) == pytest.approx(0.02 * (1 - np.exp(-times / 2e-3)))
    let_go = force("letting_go", both, d, np.zeros(1000))
    assert let_go[:150] == pytest.approx(np.full(150, 0.02), rel=1e-3)
    assert np.abs(let_go[250:]).max() < 1e-6


def test_every_family_has_a_number_a_key_and_a_formula_of_its_own() -> None:
    assert [f.number for f in FAMILIES] == list(range(len(FAMILIES)))
    assert len({f.key for f in FAMILIES}) == len(FAMILIES)
    for form in FAMILIES:
        for mechanism in form.mechanisms:
            for bench in benches():
                for values in mechanism.trials(bench.scale):
                    assert form_of(values) is form
                    assert mechanism.statement(values, "spring")[0].isupper()
                    assert all(q.low <= values[q.name] <= q.high for q in mechanism.parameters)


def test_at_one_load_no_law_has_an_exponent_of_it() -> None:
    at_once = learned_mechanisms(one_load=True)
    assert len(at_once) == len(learned_mechanisms())
    assert all(q.name != "load_exponent" for m in at_once for q in m.parameters)
    for mechanism in at_once:
        for bench in benches():
            tried = mechanism.trials(bench.scale)
            assert len({tuple(sorted(values.items())) for values in tried}) == len(tried)
            assert all("(P" not in mechanism.statement(values, "pad") for values in tried)


def test_a_small_law_has_an_effect_in_proportion_to_its_strength() -> None:
    tried = 0
    for mechanism in learned_mechanisms():
        for bench in benches():
            for place in mechanism.places(bench.rig)[:1]:
                for values in mechanism.trials(bench.scale):
                    if isinstance(mechanism, AddedBody) or mechanism.strength is None:
                        continue  # as light as the listed one, whose test is its own; as strong as it is
                    whole = effect(mechanism, values, bench, place)
                    half = effect(mechanism, scaled(mechanism, values, 0.5), bench, place)
                    size = float(np.abs(whole).max())
                    assert np.abs(whole - 2 * half).max() <= 1e-2 * size
                    tried += size > 0
    assert tried > 40
