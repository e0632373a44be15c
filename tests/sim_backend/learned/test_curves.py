"""Curves that are learned, against integrals of scipy's own interpolation and closed forms."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from sim_backend.arrays import Real
from sim_backend.force_law import MEMORY, along
from sim_backend.learned.curves import BEND, CROWDED, HIGHEST, LOWEST, SLOPED, Curve, begin_values
from sim_backend.learned.families import CURVES, form_named, form_of, learned_mechanisms
from sim_backend.learned.forms import Form
from sim_backend.mechanisms.kinds import AtRest, ForceLaw

REACH, SPEED = 4e-3, 0.3
FINE = 4001


def law(key: str, values: Mapping[str, float], d: Real, v: Real) -> Real:
    mechanism = form_named(key).mechanism
    assert isinstance(mechanism, ForceLaw)
    packed = mechanism.packed(values, AtRest(), 1e-3)
    return np.asarray(along(mechanism.law, packed[None], d, v, 0.0, 1e-3, np.zeros(MEMORY))[0])


def bent(key: str, crowded: float, seed: int = 1) -> dict[str, float]:
    """Values of a curve with bends at random."""
    form, random = form_named(key), np.random.default_rng(seed)
    values = begin_values(form, (-3e-3, REACH), (-SPEED, 0.2), 1.0, crowded)
    return {k: float(random.normal()) if k.startswith(BEND) or k == "at_rest" else v for k, v in values.items()}


def points(values: Mapping[str, float]) -> tuple[Real, Real]:
    """Where a curve bends, and how much, from its values."""
    bends = np.array([v for k, v in values.items() if k.startswith(BEND)])
    even = np.linspace(-1, 1, bends.size)
    at = np.abs(even) ** values[CROWDED]
    return np.where(even < 0, values[LOWEST] * at, values[HIGHEST] * at), bends


def integral(y: Real, x: Real) -> Real:
    """From zero."""
    grown = cumulative_simpson(y, x=x, initial=0.0)
    return np.asarray(grown - np.interp(0.0, x, grown))


@pytest.mark.parametrize("crowded", [1.0, 2.0])
@pytest.mark.parametrize("key", ["curve_of_deflection_13", "curve_of_rate_7", "curve_of_deflection_and_slope_7"])
def test_a_force_is_the_second_integral_of_its_bends(key: str, crowded: float) -> None:
    values = bent(key, crowded)
    at, bends = points(values)
    x = np.linspace(values[LOWEST], values[HIGHEST], FINE)
    expected = integral(integral(np.interp(x, at, bends), x), x) + values.get("at_rest", 0.0) * x
    d, v = (x * REACH, 0 * x) if "deflection" in key else (0 * x, x * SPEED)
    assert law(key, values, d, v) == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize("crowded", [1.0, 2.0])
@pytest.mark.parametrize("key", ["damping_curve_7", "damping_curve_and_slope_13"])
def test_a_damping_is_the_integral_of_its_bends_times_the_rate(key: str, crowded: float) -> None:
    values = bent(key, crowded)
    at, bends = points(values)
    x, v = np.linspace(values[LOWEST], values[HIGHEST], FINE), np.linspace(-1.0, 2.0, FINE)
    expected = (integral(np.interp(x, at, bends), x) + values.get("at_rest", 0.0)) * v / SPEED
    assert law(key, values, x * REACH, v) == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize("form", CURVES, ids=lambda form: form.key)
def test_beyond_what_was_seen_forces_are_straight_and_dampings_constant(form: Form) -> None:
    values = bent(form.key, 1.0)
    beyond = np.array([1.2, 1.4, 1.6])
    for end in (values[LOWEST], values[HIGHEST]):
        d, v = beyond * end * REACH, beyond * end * SPEED if form.key.startswith("curve_of_rate") else np.full(3, SPEED)
        force = law(form.key, values, d, v)
        assert force[2] - force[1] == pytest.approx(force[1] - force[0], abs=1e-9)
        if form.key.startswith("damping"):
            assert force == pytest.approx(force[0])


@pytest.mark.parametrize("form", CURVES, ids=lambda form: form.key)
def test_a_curve_is_a_family_that_has_no_formula(form: Form) -> None:
    values = bent(form.key, 2.0)
    mechanism = form.mechanism
    assert form_of(values) is form
    assert not form.formula
    assert isinstance(mechanism, Curve)
    assert mechanism not in learned_mechanisms()
    assert {q.name for q in mechanism.parameters} <= set(values)
    assert all(spread > 0 for spread in mechanism.spread(values).values())
    assert (SLOPED in form.key) is ("at_rest" in values)
    nothing = {**values, **{q.name: 0.0 for q in mechanism.parameters}}
    assert not np.any(law(form.key, nothing, np.linspace(-1, 1, 9) * REACH, np.linspace(-1, 1, 9)))


def test_a_force_is_in_proportion_to_all_its_bends() -> None:
    values = bent("curve_of_deflection_and_slope_13", 2.0)
    d = np.linspace(-1.2, 1.2, 25) * REACH
    twice = {k: 2 * v if k.startswith(BEND) or k == "at_rest" else v for k, v in values.items()}
    once = law("curve_of_deflection_and_slope_13", values, d, 0 * d)
    assert law("curve_of_deflection_and_slope_13", twice, d, 0 * d) == pytest.approx(2 * once)
