"""What weights weigh."""

import math

import pytest

from calibration.settings import CalibrationSettings
from calibration.weights import local_gravity, normal_gravity, permissible_error_mg


@pytest.mark.parametrize(("latitude", "gravity"), [(0, 9.7803253359), (90, 9.8321849379), (45, 9.806199203)])
def test_normal_gravity_is_that_of_wgs_84(latitude, gravity):
    # NIMA TR8350.2, Table 3.4; at 45 degrees GRS 80, whose ellipsoid is 1.4e-6 m/s2 away
    assert normal_gravity(latitude) == pytest.approx(gravity, abs=2e-6)


@pytest.mark.parametrize(
    ("place", "latitude", "height", "measured"),
    [
        # absolute gravity at national institutes and towers of the field, rounded
        ("Paris, Sevres", 48.829, 66, 9.80926),
        ("Braunschweig", 52.297, 69, 9.81252),
        ("Boulder", 40.131, 1682, 9.79623),
    ],
)
def test_gravity_by_latitude_and_height_is_within_its_uncertainty(place, latitude, height, measured):
    gravity = local_gravity(None, latitude, height)
    assert abs(gravity.value - measured) < 2 * gravity.standard_uncertainty, place


def test_gravity_nobody_knows_lies_between_equator_and_pole():
    gravity = local_gravity(None, None, None)
    half = math.sqrt(3) * gravity.standard_uncertainty
    assert gravity.value - half < normal_gravity(0, 1000)
    assert normal_gravity(90) - 2e-4 < gravity.value + half


@pytest.mark.parametrize(("mass", "weight_class", "error"), [(100, "M1", 5.0), (20, "F2", 0.8), (30, "M2", 14.0)])
def test_permissible_errors_are_those_of_the_recommendation(mass, weight_class, error):
    assert permissible_error_mg(mass, weight_class) == pytest.approx(error)


def test_a_mass_pulls_by_local_gravity_less_buoyancy():
    settings = CalibrationSettings(weights_g=(0, 50, 100), gravity_m_s2=9.81)
    assert settings.loads_mn[2] == pytest.approx(981.0 * (1 - 1.2 / 8000))


def test_a_class_says_how_uncertain_each_weight_is():
    settings = CalibrationSettings(weight_class="M1", gravity_m_s2=9.80665)
    # 5 mg of 100 g, evenly distributed
    assert settings.weight_errors_mn([0.0, 980.4])[1] == pytest.approx(5e-3 * 9.8045 / math.sqrt(3), rel=1e-6)
    assert settings.weight_errors_mn([0.0])[0] == 0.0
