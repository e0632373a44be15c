"""Other constants with which all channels show the same; against the transfer functions written out."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.recordings.other_constants import other_values, same_shown, undetermined_between
from analysis.mismatch.rig_description import DescribedRig
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Complex

TOP = "[{channel: a, of: upper, shows: acceleration}]"
K, C = (30000.0, 14000.0), (8.0, 4.0)


def shaken(sensors: str, lower: str = "1.0", foot: str = "stiffness: unknown, damping: unknown") -> DescribedRig:
    return parse_rig(
        f"bodies: {{lower: {lower}, upper: 0.6}}\n"
        f"joints:\n  - {{name: foot, between: [lower, ground], {foot}}}\n"
        "  - {name: neck, between: [upper, lower], stiffness: unknown, damping: unknown}\n"
        f"inputs: [{{channel: u, base_acceleration: true}}]\nsensors: {sensors}\n"
    )


def values_of(rig: DescribedRig) -> dict[str, float]:
    own = {"stiffness of foot": K[0], "stiffness of neck": K[1], "damping of foot": C[0], "damping of neck": C[1]}
    return {p.name: p.value for p in rig.arrangement.parameters} | own


def upper_over_base(k: tuple[float, float], c: tuple[float, float]) -> Complex:
    """Return the absolute acceleration of the upper body over that of the base, of two bodies in a chain."""
    s = 2j * np.pi * np.geomspace(1, 200, 400)
    z1, z2 = k[0] + c[0] * s, k[1] + c[1] * s
    return np.asarray(z1 * z2 / ((s**2 + z1 + z2) * (0.6 * s**2 + z2) - z2**2))


def test_two_stiffnesses_under_one_sensor_have_another_solution_that_shows_the_same() -> None:
    rig = shaken(TOP)
    (other,) = other_values(rig, values_of(rig))
    k = other["stiffness of foot"], other["stiffness of neck"]
    c = other["damping of foot"], other["damping of neck"]
    assert k[0] == pytest.approx(37333.33, rel=1e-6)
    assert upper_over_base(k, c) == pytest.approx(upper_over_base(K, C), rel=1e-6)


@pytest.mark.parametrize(
    "sensors",
    ["[{channel: a, of: lower, shows: acceleration}]", f"{TOP[:-1]}, {{channel: b, of: lower, shows: displacement}}]"],
)
def test_seen_below_too_there_is_one_solution(sensors: str) -> None:
    rig = shaken(sensors)
    assert same_shown(rig, values_of(rig)) == []
    assert undetermined_between(rig) is None


def test_one_of_them_given_there_is_one_solution() -> None:
    rig = shaken(TOP, foot=f"stiffness: {K[0]}, damping: unknown")
    assert same_shown(rig, values_of(rig)) == []
    assert undetermined_between(rig) is None


def test_what_is_declared_with_an_uncertainty_stays() -> None:
    rig = shaken(TOP, lower="{value: 1.0, uncertainty: 0.01}")
    (other,) = same_shown(rig, values_of(rig))
    assert other["mass of lower"] == 1.0


def test_where_any_number_show_the_same_none_is_singled_out() -> None:
    rig = parse_rig(
        "bodies: {lower: 1.0, upper: 0.6}\n"
        "joints: [{name: foot, between: [lower, ground]}, {name: neck, between: [upper, lower]}]\n"
        "inputs: [{channel: u, force_on: lower, gain: unknown}]\n"
        "sensors: [{channel: a, of: upper, shows: acceleration, gain: unknown}]\n"
    )
    assert same_shown(rig, values_of(rig) | {"gain of input 1": 1.0, "gain of sensor 1": 1.0}) == []


def test_constants_that_cannot_be_computed_cost_no_answer() -> None:
    rig = shaken(TOP)
    assert other_values(rig, values_of(rig) | {"stiffness of foot": np.nan}) == []


def test_the_check_of_a_rig_says_which_constants_to_give() -> None:
    found = undetermined_between(shaken(TOP))
    assert found is not None
    assert set(found.factors) == {"stiffness of foot", "stiffness of neck", "damping of foot", "damping of neck"}
    assert "another set of values" in found.statement
