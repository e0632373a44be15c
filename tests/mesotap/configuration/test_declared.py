"""Uncertainties of a session's masses and springs: those of the configuration that the session keeps."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from analysis.mismatch.answer import LOAD_SCALE
from daq.records import CalibrationPoints, Impact, RigDescription, Session
from mesotap.configuration.config import Config, effective_text
from mesotap.configuration.declared import header_uncertainty, rig_settings
from rig.settings import RigSettings

HEADER = RigDescription(0.107, 0.108, 4.6e5, 4.7e5, 25000.0, 10.0, 1, 10000.0, 4, "butterworth", 100.0, 16)
OWN = {
    "masses": {"m1_kg": 0.2, "m2_kg": 0.3, "uncertainty_kg": 0.002},
    "springs": {"k1_n_per_m": 4.6e5, "k2_n_per_m": 4.7e5, "uncertainty_percent": 5.0},
}


def session(config: str) -> Session:
    return Session("2026-01-01T00:00:00Z", HEADER, (), source="made", config=config)


def whole(**more: Any) -> dict[str, Any]:
    """Return the program's own configuration with `OWN` masses and springs."""
    content = yaml.safe_load(effective_text(Config()))
    content["rig"] |= deepcopy(OWN)
    return content | more


def test_springs_declared_to_5_percent_are_uncertain_by_it() -> None:
    found = header_uncertainty(session(yaml.safe_dump(whole())))
    assert (found["k1_n_per_m"], found["k2_n_per_m"]) == pytest.approx((0.05 * 4.6e5, 0.05 * 4.7e5))


def test_masses_are_as_uncertain_as_declared() -> None:
    found = header_uncertainty(session(yaml.safe_dump(whole())))
    assert (found["m1_kg"], found["m2_kg"]) == (0.002, 0.002)


def test_what_is_not_known_of_the_tube_springs_is_not_known_of_the_masses() -> None:
    content = whole()
    content["rig"]["springs"] |= {"added_mass_kg": 0.003, "added_mass_uncertainty_percent": 50.0}
    assert header_uncertainty(session(yaml.safe_dump(content)))["m1_kg"] == pytest.approx(0.0025)


def test_loads_are_as_uncertain_in_common_as_the_calibrations_leave_them() -> None:
    weights = np.linspace(0.0, 1000.0, 11)
    points = CalibrationPoints(weights, 0.35 + 0.042 * weights, "2026-01-01T00:00:00Z")
    later = replace(points, time="2026-01-01T02:00:00Z")
    tap = Impact(
        0, 0, 500.0, 500.0, 500.0, "2026-01-01T01:00:00Z", 25000.0, 100, np.zeros((2, 400)), True
    )  # fmt: skip
    calibrated = replace(session(""), impacts=(tap,), pre=points, post=later)
    # gravity is not declared: it differs by 0.5 % from the equator to the poles
    assert 1e-3 < header_uncertainty(calibrated)[LOAD_SCALE] < 3e-3
    here = yaml.safe_dump(whole(calibration={"gravity_m_s2": 9.81}))
    assert header_uncertainty(replace(calibrated, config=here))[LOAD_SCALE] < 1e-3
    assert LOAD_SCALE not in header_uncertainty(replace(calibrated, pre=None, post=None))


@pytest.mark.parametrize(
    "config",
    ["", " \n", "[", "- 1", "text", "rig:", "rig: 5", "rig: {springs: 5}", "rig: {springs: {k1_n_per_m: 1}}", "\0"],
)
def test_an_empty_or_unreadable_configuration_is_the_programs_own(config: str) -> None:
    assert rig_settings(session(config)) == RigSettings()


def test_the_programs_own_springs_are_uncertain_by_1_percent() -> None:
    assert header_uncertainty(session(""))["k1_n_per_m"] == pytest.approx(0.01 * 4.6e5)


@pytest.mark.parametrize("section", ["", "rig", "masses", "springs"])
def test_an_older_configuration_with_unknown_keys_keeps_its_masses_and_springs(section: str) -> None:
    content = whole()
    within = {"": content, "rig": content["rig"], **content["rig"]}[section]
    within["of_long_ago"] = 1
    found = rig_settings(session(yaml.safe_dump(content)))
    assert found.masses.model_dump() == OWN["masses"]
    assert (found.springs.k1_n_per_m, found.springs.uncertainty_percent) == (4.6e5, 5.0)


def test_a_folder_of_mechanisms_that_is_gone_changes_no_spring() -> None:
    content = whole()
    content["analysis"]["mechanisms"] = ["/nowhere/at/all"]
    assert rig_settings(session(yaml.safe_dump(content))).springs.uncertainty_percent == 5.0
