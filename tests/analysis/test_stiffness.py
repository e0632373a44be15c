"""Contact stiffness and damping from resonances, against eigenvalues of Eq. 9."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.stiffness import (
    ResonanceError,
    contact_estimate,
    contact_from_pole,
    contact_gradient,
    contact_stiffness,
    pole,
    ring_spring_stiffness,
    springs_from_system_mode,
)
from calibration.estimate import Estimate

M1, M2 = 0.107, 0.108  # Sec. 3.1
K = 0.5379e6


def poles(m1, m2, k1, k2, k_c, c_c=0.0):
    """Roots of Eq. 9 with positive imaginary part, lower frequency first: eigenvalues of the state matrix."""
    stiffness = np.array([[k1 + k_c, -k_c], [-k_c, k2 + k_c]])
    damping = c_c * np.array([[1, -1], [-1, 1]])
    inverse = np.diag([1 / m1, 1 / m2])
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    roots = np.linalg.eigvals(state)
    return sorted(roots[roots.imag > 0], key=abs)


testers = st.tuples(
    st.floats(0.05, 0.5), st.floats(0.05, 0.5), st.floats(1e5, 1e6), st.floats(1e5, 1e6), st.floats(2e6, 5e7)
)


@given(testers)
def test_eq_11_inverts_the_undamped_eigenvalue(tester):
    m1, m2, k1, k2, k_c = tester
    f2 = abs(poles(m1, m2, k1, k2, k_c)[1]) / (2 * np.pi)
    assert contact_stiffness(f2, m1, m2, k1, k2) == pytest.approx(k_c, rel=1e-9)


def test_eq_11_inverts_the_undamped_eigenvalue_to_1e_10():
    f2 = abs(poles(M1, M2, K, K, 7.3e6)[1]) / (2 * np.pi)
    assert contact_stiffness(f2, M1, M2, K, K) == pytest.approx(7.3e6, rel=1e-10)


@given(testers, st.floats(0.001, 0.25))
def test_eq_10_inverts_the_damped_eigenvalue(tester, damping_ratio):
    m1, m2, k1, k2, k_c = tester
    c_c = 2 * damping_ratio * np.sqrt(k_c * m1 * m2 / (m1 + m2))
    k_found, c_found = contact_from_pole(poles(m1, m2, k1, k2, k_c, c_c)[1], m1, m2, k1, k2)
    assert k_found == pytest.approx(k_c, rel=1e-9)
    assert c_found == pytest.approx(c_c, rel=1e-8)


def test_seventeen_percent_damping_is_inverted_to_1e_10():
    s = poles(M1, M2, K, 1.1 * K, 0.7e6, 100.0)[1]
    assert contact_from_pole(s, M1, M2, K, 1.1 * K) == pytest.approx((0.7e6, 100.0), rel=1e-10)


def test_without_damping_both_agree():
    s = pole(1855.0, 0.0)
    k_c, c_c = contact_from_pole(s, M1, M2, K, K)
    assert k_c == pytest.approx(float(contact_stiffness(1855.0, M1, M2, K, K)), rel=1e-12)
    assert c_c == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("zeta", [0.0016, 0.17])
def test_gradient_agrees_with_differences(zeta):
    at = np.array([1855.0, zeta, M1, M2, K, 1.05 * K])
    _, _, gradient = contact_gradient(*at)
    for i, step in enumerate(1e-5 * at):  # central differences lose eps k_c / step to rounding
        up, down = at.copy(), at.copy()
        up[i] += step
        down[i] -= step
        difference = (np.array(contact_gradient(*up)[:2]) - contact_gradient(*down)[:2]) / (2 * step)
        np.testing.assert_allclose(gradient[:, i], difference, rtol=1e-6, atol=2e-10 * 7e6 / at[i])


def test_uncertainty_agrees_with_monte_carlo():
    rng = np.random.default_rng(31)
    centre = np.array([1855.0, 0.02, M1, M2, K, K])
    errors = np.array([1.5, 4e-4, 5e-5, 5e-5, 5e3, 5e3])
    covariance = np.diag(errors**2)
    covariance[4, 5] = covariance[5, 4] = -0.5 * errors[4] * errors[5]
    draws = rng.multivariate_normal(centre, covariance, 3000)
    sample = np.array([contact_from_pole(pole(f, z), *rest) for f, z, *rest in draws])
    estimate = contact_estimate(*(Estimate(v, e) for v, e in zip(centre, errors, strict=True)), covariance)
    assert estimate.stiffness_n_per_m.standard_error == pytest.approx(sample[:, 0].std(), rel=0.06)
    assert estimate.damping_n_s_per_m.standard_error == pytest.approx(sample[:, 1].std(), rel=0.06)
    assert estimate.covariance[0, 1] == pytest.approx(np.cov(sample.T)[0, 1], rel=0.25, abs=2e-2 * 3e4)


def test_degrees_of_freedom_are_those_of_the_one_uncertain_input():
    exact = [Estimate(v, 0.0) for v in (M1, M2, K, K)]
    estimate = contact_estimate(Estimate(1855.0, 1.0, 7), Estimate(0.02, 0.0), *exact)
    assert estimate.stiffness_n_per_m.dof == pytest.approx(7)


def test_springs_of_the_published_system_modes():
    assert springs_from_system_mode(356.0, np.inf, M1, M2)[0] == pytest.approx(0.5379e6, rel=1e-4)
    assert springs_from_system_mode(281.0, np.inf, M1, M2)[0] == pytest.approx(0.3351e6, rel=1e-4)


@given(testers, st.floats(0.5, 2.0))
def test_springs_invert_the_lower_eigenvalue(tester, ratio):
    m1, m2, k1, _, k_c = tester
    f1 = abs(poles(m1, m2, k1, ratio * k1, k_c)[0]) / (2 * np.pi)
    assert springs_from_system_mode(f1, k_c, m1, m2, ratio) == pytest.approx((k1, ratio * k1), rel=1e-8)


def test_springs_of_a_soft_contact_belong_to_the_lower_mode():
    f1 = abs(poles(M1, M2, K, K, 1e4)[0]) / (2 * np.pi)
    assert springs_from_system_mode(f1, 1e4, M1, M2)[0] == pytest.approx(K, rel=1e-9)


def test_a_stiff_contact_is_the_limit():
    finite = springs_from_system_mode(356.0, 1e14, M1, M2)
    assert finite == pytest.approx(springs_from_system_mode(356.0, np.inf, M1, M2), rel=1e-7)


def test_contact_hardly_matters_to_the_springs_of_equal_masses():
    soft, stiff = (springs_from_system_mode(356.0, k_c, M1, M2)[0] for k_c in (4e6, np.inf))
    assert soft == pytest.approx(stiff, rel=1e-5)


def test_ring_spring_of_the_tube():
    k = ring_spring_stiffness(193e9, 30e-3, 0.5e-3, 9.25e-3)
    assert k == pytest.approx(0.512e6, rel=1e-3)
    assert np.sqrt(2 * k / (M1 + M2)) / (2 * np.pi) == pytest.approx(348, abs=1)


@pytest.mark.parametrize("f2", [100.0, 356.0, float("nan"), -1.0])
def test_no_contact_stiffness_at_or_below_the_system_resonance(f2):
    with pytest.raises(ResonanceError, match="not above the system resonance"):
        contact_stiffness([1855.0, f2], M1, M2, K, K)


def test_no_contact_between_the_modes_of_the_single_masses():
    # Between sqrt(k1/m1) and sqrt(k2/m2) only a negative stiffness has a root.
    f2 = np.sqrt(1.3 * K / M1) / (2 * np.pi)
    with pytest.raises(ResonanceError):
        contact_stiffness(f2, M1, M2, K, 2 * K)
    with pytest.raises(ResonanceError):
        contact_from_pole(pole(f2, 0.0), M1, M2, K, 2 * K)


def test_a_pole_needs_an_oscillation():
    with pytest.raises(ResonanceError, match="not an oscillation"):
        contact_from_pole(complex(-100.0, 0.0), M1, M2, K, K)
    with pytest.raises(ResonanceError, match="not an oscillation"):
        pole(100.0, 1.0)


def test_masses_and_springs_must_make_sense():
    with pytest.raises(ResonanceError, match="m1"):
        contact_stiffness(1855.0, 0.0, M2, K, K)
    with pytest.raises(ResonanceError, match="k2"):
        contact_from_pole(pole(1855.0, 0.01), M1, M2, K, -1.0)
    with pytest.raises(ResonanceError, match="must be positive"):
        springs_from_system_mode(356.0, -1.0, M1, M2)
