"""The example of docs/mechanisms.md, in a folder of the user's: listed, checked, simulated, named, adopted, proved."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mesotap.campaigns.engine import Processes
from mesotap.configuration.config import load_config
from mesotap.proof.sealed import answer_of, diagnose_all
from sim_backend.mechanisms.catalogue import catalogue
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input
from tests.mesotap.installed import ROOT
from tests.mesotap.test_cli import QUICK, mesotap, refused

EXAMPLE = ROOT / "tests" / "example_package" / "mesotap_example" / "cubed_rate_damping.py"
ID, PARAMETER, TRUE = "cubed_rate_damping", "cubed_rate_damping_n_s3_per_m3", 2e5
FEW = {ID, "quadratic_damping", "hertz_stiffness", "tube_spring_cubic"}  # enough rivals for a test
SHORT = [part for name in catalogue() if name not in FEW for part in ("--without", name)]
SIMULATED = f"sim_backend.mechanisms=[{{id: {ID}, parameters: {{{PARAMETER}: {TRUE}}}}}]"
IMPACTS = "mesotap.impacts_per_load=4"
STEADY = "sim_backend.contact={stiffness_scatter_percent: 0, damping_scatter_percent: 0}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a working folder whose configuration names a folder of mechanisms."""
    place = tmp_path_factory.mktemp("own")
    (place / "mine").mkdir()
    shutil.copyfile(EXAMPLE, place / "mine" / EXAMPLE.name)
    (place / "config.yaml").write_text("analysis: {mechanisms: [mine]}\n")
    return place


@pytest.fixture(scope="module")
def session(folder: Path) -> Path:
    changes = [*QUICK, *(part for change in (SIMULATED, STEADY, IMPACTS) for part in ("--set", change))]
    mesotap("run", "--simulate", *changes, "--output", "made", cwd=folder)
    return folder / "made" / "session.h5"


def test_the_example_is_short_and_the_one_in_the_docs() -> None:
    text = EXAMPLE.read_text()
    assert len(text.splitlines()) <= 60
    assert text in (ROOT / "docs" / "mechanisms.md").read_text()


def test_it_is_listed(folder: Path) -> None:
    assert ID in mesotap("mechanisms", cwd=folder).stdout
    assert ID not in mesotap("mechanisms", cwd=folder / "mine").stdout


def test_its_file_can_be_checked(folder: Path) -> None:
    said = mesotap("mechanisms", "--check", "mine/cubed_rate_damping.py", cwd=folder).stdout
    assert "FAILS" not in said
    (folder / "none.py").write_text("x = 1\n")
    assert "holds no MECHANISM" in mesotap("mechanisms", "--check", "none.py", cwd=folder, code=2).stdout


def test_without_its_folder_it_is_no_mechanism(folder: Path) -> None:
    said = refused("run", "--simulate", "--set", SIMULATED, "--set", "analysis.mechanisms=[]", cwd=folder)
    assert f"unknown mechanism '{ID}'" in said


@pytest.mark.long
def test_it_is_named_in_a_session_and_adopted(folder: Path, session: Path) -> None:
    mesotap("diagnose", session, *SHORT, "--json", "answer.json", cwd=folder)
    (named,) = json.loads((folder / "answer.json").read_text())["mechanisms"]
    assert named["id"] == ID
    assert named["parameters"][PARAMETER]["low"] < TRUE < named["parameters"][PARAMETER]["high"]
    mesotap("adopt", "answer.json", "--output", "twin.yaml", cwd=folder)
    (adopted,) = load_config(folder / "twin.yaml").sim_backend.mechanisms
    assert adopted.adopted().mechanism.id == ID


@pytest.mark.long
def test_it_is_named_in_a_described_rig(folder: Path) -> None:
    omega, rate, samples = 2 * np.pi * 12, 200.0, 2400
    u = noise_input(samples, rate, 2, 25, seed=3)
    x, _ = motion(lambda s, x, v: 100 * s - omega**2 * x - 1.0 * v - 0.1 * v**3, [0.0, 0.0], samples, rate, u)
    table = np.column_stack([np.arange(samples) / rate, u, x])
    np.savetxt(folder / "driven.csv", table, delimiter=",", header="time [s],force,position", comments="")
    (folder / "rig.yaml").write_text(
        "bodies: {mass: 1}\n"
        "springs: [{between: [mass, ground]}]\n"
        "dampers: [{between: [mass, ground]}]\n"
        "inputs: [{channel: force, force_on: mass, gain: unknown}]\n"
        "sensors: [{channel: position, of: mass, shows: displacement}]\n"
    )
    mesotap("diagnose", "driven.csv", "--rig", "rig.yaml", *SHORT, "--json", "rig.json", cwd=folder)
    (named,) = json.loads((folder / "rig.json").read_text())["mechanisms"]
    assert named["id"] == ID
    assert named["parameters"][PARAMETER]["value"] == pytest.approx(0.1, rel=0.05)


@pytest.mark.long
def test_a_proof_knows_it(folder: Path, session: Path, tmp_path: Path) -> None:
    diagnose_all({"own": [session]}, {}, tmp_path, Processes(1), lambda done, total: None, [str(folder / "mine")])
    assert [m["id"] for m in answer_of(tmp_path, "own")["mechanisms"]] == [ID]
