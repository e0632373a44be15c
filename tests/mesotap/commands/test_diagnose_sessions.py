"""Sessions held against a rig that somebody describes: `mesotap diagnose session.h5 --rig FILE`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mesotap.configuration import rig_files
from mesotap.proof.generator.scenarios import Scenario, make
from sim_backend.mechanisms.catalogue import catalogue
from tests.mesotap.test_cli import mesotap, refused

pytestmark = pytest.mark.slow  # every test needs a diagnosis

SHIPPED = Path(rig_files.__file__).parent / rig_files.TESTER_FILE
FEW = {"quadratic_damping", "hertz_stiffness", "tube_spring_cubic"}  # enough rivals for a test
SHORT = [part for name in catalogue() if name not in FEW for part in ("--without", name)]


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    scenario = Scenario(0, "single", ("quadratic_damping",), (60.0,))
    make(3, scenario, folder)
    return folder / f"{scenario.name}.h5"


def answered(folder: Path, *arguments: Any) -> dict[str, Any]:
    mesotap("diagnose", *arguments, *SHORT, "--json", folder / "answer.json")
    answer: dict[str, Any] = json.loads((folder / "answer.json").read_text())
    return {key: value for key, value in answer.items() if key != "seconds"}


def rig_file(folder: Path, *changes: tuple[str, str]) -> Path:
    """Return the shipped description with some of its text changed."""
    text = SHIPPED.read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path = folder / "rig.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_eq_9_as_a_rig_file_gives_the_answer_of_the_built_in_one(session: Path, tmp_path: Path) -> None:
    built_in = answered(tmp_path, session)
    assert [m["id"] for m in built_in["mechanisms"]] == ["quadratic_damping"]
    assert answered(tmp_path, session, "--rig", rig_file(tmp_path)) == built_in


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            ("parts:", "inputs: [{channel: 2, force_on: upper mass}]\nparts:"),
            "holds impacts; two-mass tester describes",
        ),
        (("  - {name: B, channel: 1, of: lower mass, shows: acceleration, unit: m/s2}\n", ""), "has 2 channels"),
        (("{header: k1_n_per_m, symbol: k1}", "unknown"), "does not say stiffness of upper tube spring"),
        (("{header: k1_n_per_m, symbol: k1}", "{header: k3_n_per_m}"), "springs.0.stiffness.header is 'k3_n_per_m'"),
    ],
)
def test_a_description_that_impacts_cannot_be_held_against_is_refused(
    session: Path, tmp_path: Path, change: tuple[str, str], said: str
) -> None:
    assert said in refused("diagnose", session, "--rig", rig_file(tmp_path, change))
