"""Differences between sessions: what is common cancels, and false alarms come as often as they say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mesotap.catalogue.comparing import differences, holm
from mesotap.catalogue.curves import STIFFNESS, compared_from
from mesotap.catalogue.groups import Member, compare_groups
from mesotap.configuration.config import parse_config

LOADS = (300.0, 600.0, 900.0)
U_MASS, U_TAP, U_GRAVITY, U_READING = 0.004, 0.002, 0.003, 0.001
SLOPE = 0.6


def part(source: str, u: float, sensitivity: float, dof: float | None = None, distribution: str = "normal") -> dict:
    return {
        **{"source": source, "input_value": None, "input_unit": "1", "input_standard_uncertainty": u},
        **{"sensitivity": sensitivity, "distribution": distribution, "degrees_of_freedom": dof},
    }


def results(k_c, loads=LOADS, zeta=0.01) -> dict:
    """Results whose budgets are those from which `drawn` draws errors."""

    def estimate(value: float) -> dict[str, float]:
        return {"value": value, "low": 0.99 * value, "high": 1.01 * value}

    rows = []
    for i, (load, k) in enumerate(zip(loads, k_c, strict=True)):
        own = [part("f2: noise of 8 taps, which scatter no more than that", U_TAP, k), part("mass m1", U_MASS, k)]
        of_load = [
            part("local gravity (declared)", U_GRAVITY, load),
            part("scatter of the calibration's readings", U_READING, load),
        ]
        damping = [part("noise of 8 taps, which scatter no more than that", 1e-4, 1.0)]
        budgets = {STIFFNESS: own, "load_mn": of_load, "zeta2": damping}
        rows.append(
            {
                **{"load_set": i, "target_load_mn": LOADS[i], "load_mn": estimate(load), STIFFNESS: estimate(k)},
                **{"zeta2": estimate(zeta), "budgets": {q: {"contributions": c} for q, c in budgets.items()}},
            }
        )
    return {"loads": rows, "impacts": [], "calibration": None}


def drawn(noise, masses: float, gravity: float, ratio: float = 1.0) -> dict:
    """A session of k_c = ratio (P / 1 mN)^SLOPE, with errors of masses and gravity that are not its own."""
    load_error = gravity + U_READING * noise.standard_normal()
    k = [ratio * load**SLOPE * (1 + masses + U_TAP * noise.standard_normal()) for load in LOADS]
    return results(k, [load * (1 + load_error) for load in LOADS])


def told(a: dict, b: dict, other: str = ""):
    configs = parse_config(""), parse_config(other)
    both = [compared_from(r, c, f"/{n}", n) for r, c, n in zip((a, b), configs, "ab", strict=True)]
    return [d for d in differences(both) if d.quantity == STIFFNESS]


def test_common_masses_and_weights_cancel_in_a_ratio():
    k = [load**SLOPE for load in LOADS]
    mean = told(results(k), results(k))[0]
    assert mean.value == pytest.approx(1.0)
    of_mean = math.sqrt(2 * U_TAP**2 / 3 + 2 * (SLOPE * U_READING) ** 2)
    assert mean.half_width == pytest.approx(1.96 * of_mean, rel=1e-3)
    separate = math.sqrt(2 * (U_TAP**2 / 3 + U_MASS**2 + SLOPE**2 * (U_READING**2 + U_GRAVITY**2)))
    assert mean.separate_half_width == pytest.approx(1.96 * separate, rel=1e-2)


def test_other_masses_do_not_cancel():
    k = [load**SLOPE for load in LOADS]
    other = told(results(k), results(k), "rig: {masses: {m1_kg: 0.1071}}")[0]
    both = math.sqrt(2 * U_TAP**2 / 3 + 2 * U_MASS**2 + 2 * (SLOPE * U_READING) ** 2)
    assert other.half_width == pytest.approx(1.96 * both, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 1.008])
def test_a_false_difference_is_told_in_5_of_100_and_a_true_one_as_often_as_its_size_says(ratio):
    """500 pairs of sessions of one tester, whose masses and gravity are off by the same."""
    noise = np.random.default_rng(5)
    rejected = 0
    for _ in range(500):
        masses, gravity = U_MASS * noise.standard_normal(), U_GRAVITY * noise.standard_normal()
        mean = told(drawn(noise, masses, gravity), drawn(noise, masses, gravity, ratio))[0]
        rejected += mean.p_value < 0.05
        assert (mean.p_value < 0.05) == (not mean.low <= 1 <= mean.high)
    of_mean = math.sqrt(2 * U_TAP**2 / 3 + 2 * (SLOPE * U_READING) ** 2)
    shift = math.log(ratio) / of_mean
    power = 0.5 * math.erfc((1.96 - shift) / math.sqrt(2)) + 0.5 * math.erfc((1.96 + shift) / math.sqrt(2))
    assert rejected / 500 == pytest.approx(power, abs=3 * math.sqrt(power * (1 - power) / 500))


@pytest.mark.slow
def test_single_loads_together_raise_a_false_alarm_in_5_of_100():
    noise = np.random.default_rng(6)
    alarms = sum(
        any(d.p_value < 0.05 for d in told(drawn(noise, 0.0, 0.0), drawn(noise, 0.0, 0.0))[1:]) for _ in range(400)
    )
    assert alarms / 400 <= 0.05 + 3 * math.sqrt(0.05 * 0.95 / 400)


def test_loads_that_are_not_close_are_not_compared():
    k = [load**SLOPE for load in LOADS]
    assert told(results(k), results(k, [3 * load for load in LOADS]))[1:][0].load_mn == pytest.approx(900, rel=0.01)
    assert told(results(k), results(k, [5 * load for load in LOADS])) == []


def test_loads_a_little_apart_are_taken_to_one_load():
    shifted = [1.02 * load for load in LOADS]
    mean = told(results([load**SLOPE for load in LOADS]), results([load**SLOPE for load in shifted], shifted))[0]
    assert mean.value == pytest.approx(1.0, abs=1e-6)


def test_holm_is_the_published_procedure():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_groups_are_told_apart_by_the_scatter_of_their_specimens():
    """A group of 5 % more, specimens that scatter 1 %: the ratio's interval contains it and excludes one."""
    noise = np.random.default_rng(8)
    config, members = parse_config(""), []
    for group, ratio in (("dry", 1.0), ("worn", 1.05)):
        for i in range(5):
            own = math.exp(0.01 * noise.standard_normal())
            for repeat in range(2):
                name = f"{group}{i}{repeat}"
                session = compared_from(drawn(noise, 0.002, 0.001, ratio * own), config, f"/{name}", name)
                members.append(Member(session, group, f"{group}{i}"))
    stiffness = compare_groups(members)[0]
    found = stiffness.ratios["worn"]
    assert found.low <= math.log(1.05) <= found.high
    assert found.low > 0
    assert found.dof == pytest.approx(8, abs=2)
    between = stiffness.scatters[0]
    assert between.name == "between specimens"
    assert between.low <= 0.01 <= between.high
