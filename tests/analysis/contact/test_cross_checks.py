"""Other ways to stiffness and roughness: each returns what it was made from, with intervals that hold."""

import math

import numpy as np
import pytest

from analysis.contact import cross_checks, exponential, gaussian, hertz
from analysis.contact.inversion import TheoryError
from calibration.estimate import Estimate

FLATS = {"eta": 0.1256e12, "A_n": 1.824e-6, "E_star": 105.3e9, "R_s": 2.402e-6}
STEEL = 7800 * 5900.0  # kg/(m2 s)


def test_roughness_from_resonance():
    P = np.array([0.1, 0.5])
    np.testing.assert_allclose(cross_checks.roughness_from_stiffness(P, exponential.stiffness(P, 0.189e-6)), 0.189e-6)


def test_one_roughness_from_several_loads():
    rng = np.random.default_rng(1)
    P, inside = np.linspace(0.2, 0.9, 8), 0
    for _ in range(400):
        k = exponential.stiffness(P, 0.189e-6) * np.exp(0.05 * rng.standard_normal(8))
        estimate = cross_checks.mean_roughness(P, k)
        inside += estimate.low <= 0.189e-6 <= estimate.high
    assert 0.92 < inside / 400 < 0.98


@pytest.mark.parametrize("R_q", [20e-9, 0.189e-6, 1e-6])
def test_roughness_from_resonance_with_gaussian_heights(R_q):
    k = float(gaussian.stiffness(0.5, R_q=R_q, **FLATS))
    estimate = cross_checks.gaussian_roughness_from_stiffness(0.5, Estimate(k, 0.01 * k, 7), **FLATS)
    assert estimate.value == pytest.approx(R_q, rel=1e-8)
    # nearly k ~ 1 / R_q
    assert estimate.standard_error / estimate.value == pytest.approx(0.01, rel=0.2)


def test_stiffness_that_no_roughness_gives():
    with pytest.raises(TheoryError, match="no roughness gives"):
        cross_checks.gaussian_roughness_from_stiffness(0.5, Estimate(1e15, 1.0), **FLATS)


def test_slope_of_load_against_approach():
    P = np.linspace(0.3, 0.7, 41)
    estimate = cross_checks.stiffness_from_approach(hertz.approach(P, 794e-6, 105e9), P, 0.5, 0.05)
    assert estimate.value == pytest.approx(float(hertz.stiffness(0.5, 794e-6, 105e9)), rel=1e-3)


def test_intervals_of_the_slope_hold():
    rng = np.random.default_rng(2)
    P = np.linspace(0.4, 0.6, 25)
    truth, inside = float(hertz.stiffness(0.5, 794e-6, 105e9)), 0
    for _ in range(400):
        noisy = hertz.approach(P, 794e-6, 105e9) + 1e-9 * rng.standard_normal(25)
        estimate = cross_checks.stiffness_from_approach(noisy, P, 0.5, 0.11)
        inside += estimate.low <= truth <= estimate.high
    assert 0.92 < inside / 400 < 0.98


@pytest.mark.parametrize(
    ("P", "said"), [(np.linspace(0, 0.1, 20), "too few"), (np.linspace(0.6, 0.4, 20), "does not grow")]
)
def test_no_slope(P, said):
    with pytest.raises(TheoryError, match=said):
        cross_checks.stiffness_from_approach(np.linspace(0, 1e-7, 20), P, 0.5, 0.2)


def test_reflection_between_like_bodies():
    # R = 1 / (1 + (2 K / omega z)^2)^(1/2)
    K, f = 5e14, 10e6
    expected = 1 / math.sqrt(1 + (2 * K / (2 * math.pi * f * STEEL)) ** 2)
    assert cross_checks.reflection_coefficient(K, f, STEEL, STEEL) == pytest.approx(expected)


@pytest.mark.parametrize("z_2", [STEEL, 2700 * 6300.0])
def test_stiffness_from_reflected_ultrasound(z_2):
    f = np.linspace(5e6, 15e6, 20)
    R = cross_checks.reflection_coefficient(4e14, f, STEEL, z_2)
    assert cross_checks.stiffness_from_reflection(R, f, STEEL, z_2, 1e-6).value == pytest.approx(4e8)


def test_intervals_of_the_reflection_hold():
    rng = np.random.default_rng(3)
    f, inside = np.linspace(5e6, 15e6, 20), 0
    R = cross_checks.reflection_coefficient(4e14, f, STEEL, STEEL)
    for _ in range(400):
        estimate = cross_checks.stiffness_from_reflection(R + 0.005 * rng.standard_normal(20), f, STEEL, STEEL, 1e-6)
        inside += estimate.low <= 4e8 <= estimate.high
    assert 0.92 < inside / 400 < 0.98


def test_reflection_without_a_stiffness():
    with pytest.raises(TheoryError, match="no stiffness follows"):
        cross_checks.stiffness_from_reflection([1.0, 1.2], [1e6, 2e6], STEEL, STEEL, 1e-6)


@pytest.mark.parametrize(("P", "k"), [(0.0, 1e6), (0.5, -1.0)])
def test_roughness_needs_load_and_stiffness(P, k):
    with pytest.raises(TheoryError, match="above zero"):
        cross_checks.roughness_from_stiffness(P, k)
