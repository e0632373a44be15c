"""Values in another unit: told with what is usual and what else they may mean, before faults that follow of them."""

from __future__ import annotations

import doctest

import pytest

from mesotap.configuration import usual
from mesotap.configuration.config import ConfigError, default_text, parse_config, remarks


def told(*changes: str) -> list[str]:
    try:
        return remarks(parse_config(default_text(), "my.yaml", changes))
    except ConfigError as error:
        return str(error).split("\n")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("rig.masses.m1_kg=107", "rig.masses.m1_kg is 107 kg; usual is 0.005 to 20 kg: if 107 g is meant, write 0.107"),
        ("rig.springs.system_resonance_hz=0.356", "if 0.356 kHz is meant, write 356"),
        ("mesotap.load_plan_mn=[0.3, 0.9]", "the largest of mesotap.load_plan_mn is 0.9 mN"),
        ("mesotap.load_plan_mn=[0.3, 0.9]", "if 0.9 N is meant, write 900"),
        ("rig.limits.load_mn=1.1", "if 1.1 N is meant, write 1100"),
        ("rig.wiring.sample_rate_hz=100", "rig.wiring.sample_rate_hz is 100 Hz; usual is 5000 to 5e+06 Hz"),
        ("rig.gauge_sensitivity_mv_per_mn=42", "if 42 mV/N is meant, write 0.042"),
        ("calibration.weights_mn=[0, 0.5, 1]", "if 1 N is meant, write 1000"),
        ("rig.filter.lowpass_hz=10", "if 10 kHz is meant, write 10000"),
        (
            "rig.masses.uncertainty_kg=0.05",
            "usual is at most 5 %: if 0.05 g is meant, write 5e-05",
        ),
        ("rig.wiring.accelerometer_a.sensitivity_mv_per_g=0.1", "if 0.1 V/g is meant, write 100"),
    ],
)
def test_a_value_in_another_unit_is_told_first(change, says):
    assert says in told(change)[0]


def test_a_filter_that_lets_through_more_than_the_rate_can_tell():
    assert any(
        "nothing above 1500 Hz, and rig.filter.lowpass_hz (10000)" in line and "it needs at least 20000 Hz" in line
        for line in told("rig.wiring.sample_rate_hz=3000")
    )
    assert not any("lets more through" in line for line in told())


def test_nothing_is_unusual_about_what_is_shipped_nor_about_the_paper_s_loads():
    assert not [line for line in told() if "usual" in line]
    assert not [line for line in told("mesotap.load_plan_mn=[70, 1000]") if "usual" in line]


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"rig": None},
        {"rig": {"masses": 3}},
        {"rig": {"masses": {"m1_kg": "107"}}},
        {"rig": {"masses": {"m1_kg": 10**400}}},
    ],
)
def test_what_is_missing_or_no_number_is_passed_over(content):
    assert usual.unusual(content) == []


def test_the_example():
    assert doctest.testmod(usual).attempted == 1
