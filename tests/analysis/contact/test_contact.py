"""Theoretical contact stiffness, against closed forms, numerical derivatives and published values."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from analysis.contact import elastic, exponential, gaussian, hertz
from analysis.contact.elastic_plastic import ElasticPlasticFlats
from analysis.contact.presets import resolve
from analysis.contact.theory import plasticity, theory
from analysis.settings import PRESETS, FlatContact, Material, SphereContact

E_STAR = elastic.composite_modulus(192.92e9, 0.29, 192.92e9, 0.29)
R = 793.75e-6
FLATS = {"eta": 0.1256e12, "A_n": 1.824e-6, "E_star": E_STAR, "R_s": 2.402e-6}  # Table 4
loads = st.floats(1e-4, 10.0)


def test_composite_modulus_of_table_2():
    assert pytest.approx(105.3e9, rel=5e-4) == E_STAR


def test_composite_modulus_on_a_rigid_body():
    assert elastic.composite_modulus(200e9, 0.3, np.inf, 0.0) == pytest.approx(200e9 / 0.91)


def test_combined_radius_of_a_sphere_on_a_flat_is_the_spheres():
    assert elastic.combined_radius([R, np.inf]) == pytest.approx(R)
    assert elastic.combined_radius([2.0, 2.0]) == pytest.approx(1.0)


def test_block_of_equation_4():
    assert elastic.plane_strain_block_stiffness(105.3e9, 0.29, 10e-3, 0.76e-3) == pytest.approx(58.9e9, rel=1e-3)


@given(loads)
def test_hertz_stiffness_is_the_derivative_of_the_load(P):
    step = 1e-5 * P
    slope = 2 * step / (hertz.approach(P + step, R, E_STAR) - hertz.approach(P - step, R, E_STAR))
    assert hertz.stiffness(P, R, E_STAR) == pytest.approx(slope, rel=1e-6)


def test_hertz_load_is_equation_1():
    P = np.array([0.0, 0.05, 1.0])
    np.testing.assert_allclose(hertz.load(hertz.approach(P, R, E_STAR), R, E_STAR), P)
    assert hertz.load(-1e-9, R, E_STAR) == 0.0


def test_hertz_contact_radius():
    # k = 2 E* a with a^2 = R Delta, the stiffness of any axisymmetric contact.
    a = np.sqrt(R * hertz.approach(0.5, R, E_STAR))
    assert hertz.stiffness(0.5, R, E_STAR) == pytest.approx(2 * E_STAR * a)


def test_hertz_with_the_combined_radius_of_table_2():
    np.testing.assert_allclose(hertz.stiffness([0.05, 1.0], 739.75e-6, E_STAR), [1.35e6, 3.66e6], rtol=2e-3)


def test_rough_hertz_is_a_third():
    np.testing.assert_allclose(3 * hertz.rough_stiffness([0.1, 1], R, E_STAR), hertz.stiffness([0.1, 1], R, E_STAR))


@given(st.floats(0.0, 5.0))
def test_exponential_stiffness_is_the_derivative_of_the_load(h):
    R_q = 0.189e-6
    step = 1e-4 * R_q
    up, down = (exponential.load(h * R_q + side, R_q=R_q, **FLATS) for side in (step, -step))
    slope = -(up - down) / (2 * step)
    assert exponential.stiffness(exponential.load(h * R_q, R_q=R_q, **FLATS), R_q) == pytest.approx(slope, rel=1e-6)


def test_exponential_load_is_the_integral_over_the_asperities():
    R_q, h = 0.189e-6, 1.5
    integral, _ = integrate.quad(lambda z: (z - h) ** 1.5 * 17 * np.exp(-3 * z), h, np.inf)
    expected = 4 / 3 * FLATS["eta"] * FLATS["A_n"] * E_STAR * FLATS["R_s"] ** 0.5 * R_q**1.5 * integral
    assert exponential.load(h * R_q, R_q=R_q, **FLATS) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("n", [0.5, 1.5])
@pytest.mark.parametrize("h", [-4.0, 0.0, 2.0, 8.0])
def test_tail_moment_is_the_integral_over_the_asperities(n, h):
    integral, _ = integrate.quad(
        lambda t: t**n * np.exp(-((t + h) ** 2) / 2) / np.sqrt(2 * np.pi), 0, max(-h, 0) + 12, epsabs=0, limit=200
    )
    assert gaussian.tail_moment(n, h) == pytest.approx(integral, rel=1e-8)


@pytest.mark.parametrize(("R_q", "at_50_mn", "at_1_n"), [(10e-9, 16.6, 249), (100e-9, 2.06, 34.4), (1e-6, 0.24, 4.2)])
def test_gaussian_stiffness_of_figure_3(R_q, at_50_mn, at_1_n):
    stiffness = gaussian.stiffness([0.05, 1.0], R_q=R_q, **FLATS)
    np.testing.assert_allclose(stiffness, [at_50_mn * 1e6, at_1_n * 1e6], rtol=6e-3)


@given(st.floats(1e-9, 1e3), st.floats(1e-8, 2e-6))
def test_gaussian_separation_carries_the_load(P, R_q):
    d = gaussian.separation(P, R_q=R_q, **FLATS)
    assert gaussian.load(d, R_q=R_q, **FLATS) == pytest.approx(P, rel=1e-9)


def test_gaussian_stiffness_is_the_derivative_of_the_load():
    R_q = 0.189e-6
    P = np.geomspace(1e-6, 10, 15)
    d = gaussian.separation(P, R_q=R_q, **FLATS)
    step = 1e-4 * R_q
    slope = (gaussian.load(d - step, R_q=R_q, **FLATS) - gaussian.load(d + step, R_q=R_q, **FLATS)) / (2 * step)
    np.testing.assert_allclose(gaussian.stiffness(P, R_q=R_q, **FLATS), slope, rtol=1e-6)


def test_flattened_asperities_are_hertz_contacts_side_by_side():
    # Deep under all asperity tops, heights no longer matter: N = eta A_n contacts share the load.
    R_q = 1e-9
    count = FLATS["eta"] * FLATS["A_n"]
    P = gaussian.load(-18 * R_q, R_q=R_q, **FLATS)
    together = count * hertz.stiffness(P / count, FLATS["R_s"], E_STAR)
    assert gaussian.stiffness(P, R_q=R_q, **FLATS) == pytest.approx(together, rel=3e-3)


def test_no_load_no_gaussian_stiffness():
    assert gaussian.stiffness(0.0, R_q=1e-7, **FLATS) == 0.0
    assert np.isinf(gaussian.separation(0.0, R_q=1e-7, **FLATS))


@pytest.mark.parametrize("P", [-1.0, 1e9, float("nan")])
def test_loads_beyond_the_model_are_refused(P):
    with pytest.raises(ValueError, match="load"):
        gaussian.stiffness(P, R_q=1e-7, **FLATS)


YIELDING = ElasticPlasticFlats(R_q=0.189e-6, H=2.96e9, nu=0.29, **FLATS)


@pytest.mark.parametrize("H", [2.96e9, 20e9, 100e9])
@pytest.mark.parametrize("h", [-2.0, 0.5, 3.0])
def test_elastic_plastic_load_is_equation_6(h, H):
    flats = ElasticPlasticFlats(R_q=0.189e-6, H=H, nu=0.29, **FLATS)
    w = flats.critical_interference
    lengths = np.array([flats.R_q**1.5, flats.R_q])
    below, _ = integrate.quad(lambda z: (z - h) ** 1.5 * np.exp(-(z**2) / 2), h, min(h + w, 12), epsabs=0)
    above, _ = integrate.quad(lambda z: (2 * (z - h) - w) * np.exp(-(z**2) / 2), h + w, h + w + 20, epsabs=1e-30)
    amplitudes = (
        flats.eta
        * flats.A_n
        * np.array(
            [
                4 / (3 * np.sqrt(2 * np.pi)) * E_STAR * np.sqrt(flats.R_s),
                np.sqrt(np.pi / 2) * flats.R_s * (0.454 + 0.41 * 0.29) * H,
            ]
        )
    )
    assert flats.load(h * flats.R_q) == pytest.approx(float(amplitudes * lengths @ [below, above]), rel=1e-7)


def test_elastic_plastic_stiffness_is_the_derivative_of_the_load():
    P = np.geomspace(1e-4, 10, 9)
    d = YIELDING.separation(P)
    np.testing.assert_allclose(YIELDING.load(d), P, rtol=1e-9)
    step = 1e-4 * YIELDING.R_q
    slope = (YIELDING.load(d - step) - YIELDING.load(d + step)) / (2 * step)
    np.testing.assert_allclose(YIELDING.stiffness(P), slope, rtol=1e-6)


def test_hard_asperities_are_elastic():
    P = np.geomspace(1e-3, 3, 5)
    hard = ElasticPlasticFlats(R_q=0.189e-6, H=1e13, nu=0.29, **FLATS)
    np.testing.assert_allclose(hard.stiffness(P), gaussian.stiffness(P, R_q=0.189e-6, **FLATS), rtol=1e-6)


@pytest.mark.parametrize("H", [2.96e9, 20e9, 60e9, 100e9])
@pytest.mark.parametrize("h", [-2.0, 0.5, 3.0])
def test_unloading_sees_every_spot_as_2_e_star_times_its_radius(h, H):
    flats = ElasticPlasticFlats(R_q=0.189e-6, H=H, nu=0.29, **FLATS)
    c = flats.critical_interference * flats.R_q

    def stiffness(omega):  # of a spot whose area is pi R_s omega, or pi R_s (2 omega - omega_c) where it has yielded
        area = np.pi * flats.R_s * (omega if omega < c else 2 * omega - c)
        return 2 * E_STAR * np.sqrt(area / np.pi)

    def density(omega):
        return np.exp(-((h + omega / flats.R_q) ** 2) / 2) / np.sqrt(2 * np.pi) / flats.R_q

    highest = max(12 - h, 1.0) * flats.R_q
    ends = [0.0, min(c, highest), highest]
    parts = [
        integrate.quad(lambda w: stiffness(w) * density(w), a, b, epsabs=0, limit=200)[0]
        for a, b in itertools.pairwise(ends)
        if b > a
    ]
    expected = flats.eta * flats.A_n * sum(parts)
    assert flats.unloading_slope(h * flats.R_q) == pytest.approx(expected, rel=1e-6)


def test_unloading_of_the_published_flats_is_nearly_four_times_as_stiff_as_loading():
    P = np.array([0.265, 0.927])
    np.testing.assert_allclose(YIELDING.unloading_stiffness(P) * 1e-6, [18.8, 62.9], atol=0.05)
    np.testing.assert_allclose(YIELDING.stiffness(P) * 1e-6, [5.1, 16.3], atol=0.05)
    assert (YIELDING.yielded_share(P) > 0.999).all()
    assert YIELDING.plasticity_index == pytest.approx(11.1, abs=0.05)
    assert YIELDING.unloading_stiffness(0.0) == YIELDING.yielded_share(0.0) == 0.0


def test_elastic_asperities_unload_as_they_load():
    P = np.geomspace(1e-3, 3, 5)
    hard = ElasticPlasticFlats(R_q=0.189e-6, H=1e13, nu=0.29, **FLATS)
    np.testing.assert_allclose(hard.unloading_stiffness(P), hard.stiffness(P), rtol=1e-6)
    np.testing.assert_allclose(hard.yielded_share(P), 0, atol=1e-9)


def test_curves_say_whether_a_ring_down_sees_them():
    sees = {curve.equation: curve.unloads_alike for curve in theory("paper-flat")}
    assert sees == {"Eq. 7, 8": True, "Eq. 5": True, "Eq. 6": False, "spots of Eq. 6": True}
    said = plasticity("paper-flat", [0.2649, 0.927]).sentence(np.array([0.2649, 0.927]))
    assert "plasticity index is 11" in said
    assert "99.99 % of the load" in said
    soft = FlatContact(upper=Material(hardness_gpa=200.0), lower=Material(hardness_gpa=200.0))
    assert "stay elastic" in plasticity(soft, [0.5]).sentence(np.array([0.5]))


def test_presets_are_the_published_surfaces():
    sphere, flat = resolve("paper-sphere"), resolve("paper-flat")
    assert isinstance(sphere, SphereContact)
    assert sphere.radius_um == 793.75
    assert sphere.roughness_rq_um == pytest.approx(np.hypot(0.451, 0.137))
    assert isinstance(flat, FlatContact)
    assert flat == FlatContact()


@pytest.mark.parametrize("name", PRESETS)
def test_the_settings_name_the_same_surfaces(name):
    published, named = resolve(name).model_dump(), PRESETS[name].model_dump()
    assert published.pop("roughness_rq_um") == pytest.approx(named.pop("roughness_rq_um"), abs=5e-4)
    assert published == named


def test_unknown_preset_is_named():
    with pytest.raises(ValueError, match="paper-cube"):
        resolve("paper-cube")


def test_given_surfaces_are_taken_as_they_are():
    contact = SphereContact(upper=Material(youngs_modulus_gpa=70.0), radius_um=1000.0)
    assert resolve(contact) is contact
    modulus = elastic.composite_modulus(70e9, 0.29, 192.92e9, 0.29)
    assert theory(contact)[0].stiffness(0.5) == pytest.approx(hertz.stiffness(0.5, 1e-3, modulus))


def test_theories_by_contact():
    assert [curve.equation for curve in theory("paper-sphere")] == ["Eq. 2", "Eq. 3", "Greenwood and Tripp"]
    assert [curve.equation for curve in theory("paper-flat")][:2] == ["Eq. 7, 8", "Eq. 5"]


@pytest.mark.parametrize("contact", ["paper-sphere", "paper-flat"])
def test_every_theory_stiffens_with_load_and_keeps_the_shape(contact):
    P = np.geomspace(0.01, 3, 12).reshape(3, 4)
    for curve in theory(contact):
        stiffness = curve.stiffness(P)
        assert stiffness.shape == (3, 4)
        assert (np.diff(stiffness.ravel()) > 0).all()


# Area that really touches.


def test_hertz_area():
    # mean pressure 4 E* a / (3 pi R)
    area = hertz.contact_area(0.5, R, E_STAR)
    assert 0.5 / area == pytest.approx(4 * E_STAR * np.sqrt(area / np.pi) / (3 * np.pi * R))


def test_gaussian_area_is_the_integral_over_the_asperities():
    R_q = 0.189e-6
    h = float(gaussian.separation(0.5, R_q=R_q, **FLATS)) / R_q
    share, _ = integrate.quad(lambda z: (z - h) * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), h, 12)
    expected = np.pi * FLATS["eta"] * FLATS["A_n"] * FLATS["R_s"] * R_q * share
    assert gaussian.contact_area(0.5, R_q=R_q, **FLATS) == pytest.approx(expected, rel=1e-8)


def test_exponential_area_is_the_integral_over_the_asperities():
    R_q = 0.189e-6
    h = float(exponential.separation(0.5, R_q=R_q, **FLATS)) / R_q
    share, _ = integrate.quad(lambda t: t * 17 * np.exp(-3 * (t + h)), 0, 20)
    expected = np.pi * FLATS["eta"] * FLATS["A_n"] * FLATS["R_s"] * R_q * share
    assert exponential.contact_area(0.5, R_q=R_q, **FLATS) == pytest.approx(expected, rel=1e-8)


def test_exponential_separation_carries_the_load():
    d = exponential.separation([0.1, 1.0], R_q=1e-7, **FLATS)
    np.testing.assert_allclose(exponential.load(d, R_q=1e-7, **FLATS), [0.1, 1.0])
    assert np.isinf(exponential.separation(0.0, R_q=1e-7, **FLATS))


def test_elastic_plastic_area_is_the_integral_over_the_asperities():
    w = YIELDING.critical_interference
    h = float(YIELDING.separation(0.5)) / YIELDING.R_q

    def share(z):
        t = z - h
        return (t if t < w else 2 * t - w) * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)

    total = sum(integrate.quad(share, *ends, epsabs=1e-14)[0] for ends in ((h, h + w), (h + w, 14)))
    expected = np.pi * FLATS["eta"] * FLATS["A_n"] * FLATS["R_s"] * YIELDING.R_q * total
    assert YIELDING.contact_area(0.5) == pytest.approx(expected, rel=1e-7)


def test_elastic_plastic_area_of_hard_asperities_is_elastic():
    hard = ElasticPlasticFlats(R_q=0.189e-6, H=1e13, nu=0.29, **FLATS)
    assert hard.contact_area(0.5) == pytest.approx(float(gaussian.contact_area(0.5, R_q=0.189e-6, **FLATS)), rel=1e-6)


def test_no_load_no_area():
    assert gaussian.contact_area(0.0, R_q=1e-7, **FLATS) == 0.0
    assert YIELDING.contact_area(0.0) == 0.0


@pytest.mark.parametrize("n", [0.5, 1.0, 1.5, 2.5])
def test_tail_moment_far_below_all_heights(n):
    # the mean of (x + z)^n over the normal density
    for x in (19.9, 20.1, 300.0):
        mean, _ = integrate.quad(
            lambda z, x=x: (x + z) ** n * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), -9, 9, epsabs=0
        )
        assert gaussian.tail_moment(n, -x) == pytest.approx(mean, rel=1e-9)


@pytest.mark.parametrize("contact", ["paper-sphere", "paper-flat"])
def test_every_separation_falls_as_the_stiffness_says(contact):
    P, step = np.array([0.1, 0.9]), 1e-4
    for curve in theory(contact):
        if curve.separation is not None:
            slope = -2 * step * P / (curve.separation(P * (1 + step)) - curve.separation(P * (1 - step)))
            np.testing.assert_allclose(curve.stiffness(P), slope, rtol=1e-4)
