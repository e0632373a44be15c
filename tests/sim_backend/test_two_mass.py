"""Eq. 9 to 11 against closed forms."""

import math

import numpy as np
import pytest

from sim_backend.two_mass import TwoMass, contact_damping, tube_damping

M1, M2, K = 0.107, 0.108, 0.5379e6


def test_poles_satisfy_the_characteristic_equation():
    t = TwoMass(M1, M2, K, 1.1 * K, 7.5e6, 25.0, 3.0, 4.0)
    for s in t.poles():
        upper = t.m1 * s**2 + (t.c1 + t.cc) * s + t.k1 + t.kc
        lower = t.m2 * s**2 + (t.c2 + t.cc) * s + t.k2 + t.kc
        assert abs(upper * lower - (t.cc * s + t.kc) ** 2) < 1e-9 * abs(upper * lower)


def test_undamped_equal_masses_give_the_textbook_frequencies():
    f1, zeta1, f2, zeta2 = TwoMass(0.1, 0.1, K, K, 4e6, 0.0).modes()
    assert f1 == pytest.approx(math.sqrt(K / 0.1) / (2 * math.pi), rel=1e-12)
    assert f2 == pytest.approx(math.sqrt((K + 8e6) / 0.1) / (2 * math.pi), rel=1e-12)
    assert abs(zeta1) < 1e-12
    assert abs(zeta2) < 1e-12


def test_equal_masses_give_the_closed_form_of_the_contact_mode_damping():
    t = TwoMass(0.1, 0.1, K, K, 4e6, 50.0)
    omega = math.sqrt((K + 8e6) / 0.1)
    assert t.modes()[3] == pytest.approx(2 * 50.0 / (2 * 0.1 * omega), rel=1e-12)


@pytest.mark.parametrize("kc", [0.5e6, 3.95e6, 10.32e6])
def test_eq_11_inverts_the_undamped_contact_mode(kc):
    t = TwoMass(M1, M2, K, K, kc, 0.0)
    w2 = (2 * math.pi * t.modes()[2]) ** 2
    assert (M1 * M2 * w2**2 - (M1 + M2) * K * w2 + K**2) / ((M1 + M2) * w2 - 2 * K) == pytest.approx(kc, rel=1e-9)


@pytest.mark.parametrize(
    ("kc_mn_per_m", "f2_hz"), [(3.95, 1410), (5.87, 1701), (7.03, 1855), (7.59, 1925), (8.90, 2079), (10.32, 2234)]
)
def test_published_stiffnesses_give_the_published_resonances(kc_mn_per_m, f2_hz):
    """Table 5 and Fig. 8."""
    f1, _, f2, _ = TwoMass(M1, M2, K, K, kc_mn_per_m * 1e6, 0.0).modes()
    assert f2 == pytest.approx(f2_hz, rel=1e-3)
    assert f1 == pytest.approx(356, rel=1e-3)


def test_static_force_deflects_the_two_springs_in_parallel():
    t = TwoMass(M1, M2, K, K, 1e12, 0.0)
    rest = -np.linalg.solve(t.state_matrix(), np.array([0, 0, 1 / M1, 0]))
    assert rest[0] == pytest.approx(1 / (2 * K), rel=1e-4)
    assert rest[1] == pytest.approx(rest[0], rel=1e-4)


def test_contact_force_pushes_the_lower_mass_down():
    acceleration = TwoMass(M1, M2, K, K, 5e6, 20.0).state_space().c[0]
    assert acceleration @ [1e-6, 0, 0, 0] == pytest.approx(5.0 / M2)
    assert acceleration @ [0, 0, 1e-3, 0] == pytest.approx(0.02 / M2)


def test_contact_damping_makes_the_ratio_of_free_masses():
    t = TwoMass(M1, M2, 1e-3, 1e-3, 5e6, contact_damping(5e6, 0.17, M1, M2))
    assert t.modes()[3] == pytest.approx(0.17, rel=1e-6)


def test_tube_damping_makes_the_ratio_of_the_system_mode():
    c = tube_damping(0.01, M1, M2, K, K)
    assert TwoMass(M1, M2, K, K, 1e8, 0.0, c, c).modes()[1] == pytest.approx(0.01, rel=1e-3)


def test_overdamped_contact_has_a_damping_ratio_above_one():
    kc = 1e6
    f1, zeta1, f2, zeta2 = TwoMass(0.1, 0.1, 1.0, 1.0, kc, contact_damping(kc, 3.0, 0.1, 0.1)).modes()
    assert max(zeta1, zeta2) == pytest.approx(3.0, rel=1e-3)
    assert f2 == pytest.approx(math.sqrt(2 * kc / 0.1) / (2 * math.pi), rel=1e-3)
    assert f1 < f2


def test_without_a_contact_the_masses_swing_alone():
    f1, _, f2, _ = TwoMass(0.1, 0.2, K, K, 0.0, 0.0).modes()
    assert (f1, f2) == pytest.approx((math.sqrt(K / 0.2) / (2 * math.pi), math.sqrt(K / 0.1) / (2 * math.pi)))


def test_everything_overdamped_still_gives_numbers():
    assert np.all(np.isfinite(TwoMass(0.1, 0.1, K, K, 1e6, 5000.0, 5000.0, 5000.0).modes()))
