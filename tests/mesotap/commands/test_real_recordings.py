"""Real recordings of other rigs, from copies without names and in neutral units; skipped where they are not at hand."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner

from mesotap.cli import app

pytestmark = [pytest.mark.data, pytest.mark.long]
OSCILLATOR = """
bodies: {a: 1}
springs: [{between: [a, ground], damping: unknown}]
inputs: [{channel: 0, force_on: a, gain: unknown}]
sensors: [{channel: 1, of: a, shows: displacement}]
recording:
  rate_hz: 1000
  held_out: [{name: first, from_s: 0, to_s: 40.7}, {name: last, from_s: 118}]
"""
DECAY = """
bodies: {a: 1}
joints: [{between: [a, ground]}]
sensors: [{channel: 0, of: a, shows: acceleration}]
recording: {rate_hz: 12800, from_s: 0.26, band_hz: [50, 120]}
sweeps: {frequency: 0, force: 1, amplitude: 2, phase: 3, of: a, shows: acceleration}
"""


@pytest.fixture(scope="module")
def data() -> Path:
    folder = Path(os.environ.get("MESOTAP_DATA") or Path(__file__).parents[3] / ".." / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set MESOTAP_DATA to the folder that holds them")
    return folder


def diagnosed(folder, rig, *files):
    (folder / "r.yaml").write_text(rig)
    answer = folder / "answer.json"
    result = CliRunner().invoke(
        app, ["diagnose", *map(str, files), "--rig", str(folder / "r.yaml"), "--json", str(answer)]
    )
    assert result.exit_code == 0, result.output
    return json.loads(answer.read_text())


def test_an_oscillator_with_a_measured_input_has_a_cubic_spring_and_nothing_else(data, tmp_path):
    table = np.loadtxt(data / "silverbox" / "SNLS80mV.csv", delimiter=",")
    np.savetxt(tmp_path / "x.csv", 1e3 * table, delimiter=",", fmt="%.6g")  # the clock is another one too
    answer = diagnosed(tmp_path, OSCILLATOR, tmp_path / "x.csv")
    assert [m["id"] for m in answer["mechanisms"]] == ["tube_spring_cubic"]
    assert answer["mechanisms"][0]["indistinguishable_from"] == []
    errors = answer["fit"]["stretches"]  # thousandths of the recording's unit
    assert errors["first"]["before"] == pytest.approx(14.1, abs=0.7)
    assert errors["first"]["after"] <= 0.46
    assert errors["last"]["after"] <= 0.36


@pytest.fixture(scope="module")
def decay(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("decay")
    content = loadmat(data / "brake-reuss-beam" / "HammerImpact.mat", squeeze_me=True)
    np.savetxt(folder / "d.csv", content["HIdata"]["acc1"].item(), fmt="%.7g", header="", comments="")
    return folder


@pytest.mark.parametrize("from_s", [0.25, 0.26])
def test_one_decay_of_a_bolted_beam_leaves_amplitude_and_time_confounded(decay, tmp_path, from_s):
    answer = diagnosed(tmp_path, DECAY.replace("0.26", str(from_s)), decay / "d.csv")
    first = answer["mechanisms"][0]
    assert first["id"] == "micro_slip"
    assert "contact_creep" in first["indistinguishable_from"]
    assert first["probability"] < 0.6
    creep = next(r for r in answer["rivals"] if r["ids"] == ["contact_creep"])
    assert creep["probability"] == pytest.approx(first["probability"])
    assert creep["heldout_rms"] < 0.1  # its fit is not given up
    assert "amplitude and time" in first["statement"]
    assert "different strength" in answer["next_experiment"]["why"]
    assert answer["fit"]["heldout_rms_before"] == pytest.approx(0.5, abs=0.06)
    assert answer["fit"]["heldout_rms_after"] <= 0.10
    assert answer["remainder"]["share"] < 0.05  # 0.84 had stood beside it
    along = [(p["amplitude"], p["frequency_hz"], p["damping_ratio"]) for p in answer["decay"]]
    assert along[0][2] > 0.0020 > 0.0015 > along[-1][2]
    assert along[0][1] < 80.45 < 80.58 < along[-1][1]


def test_steady_responses_settle_it(data, decay, tmp_path):
    file = data / "brake-reuss-beam" / "ForcedFrequencyResponses.mat"
    content = loadmat(file, squeeze_me=True, struct_as_record=False)["FRdata"]
    sweeps = (*content.ForceControl, *content.ResponseControl)
    rows = [np.c_[s.frequency, s.force, s.amplitude, s.phase] for s in sweeps]
    np.savetxt(tmp_path / "s.csv", np.concatenate(rows), delimiter=",", fmt="%.8g")
    answer = diagnosed(tmp_path, DECAY, decay / "d.csv", tmp_path / "s.csv")
    first = answer["mechanisms"][0]
    assert first["id"] == "micro_slip"
    assert "contact_creep" not in first["indistinguishable_from"]
    assert first["probability"] > 0.9
    assert "amplitude is the cause" in first["statement"]
    assert answer["fit"]["heldout_rms_after"] <= 0.10
    assert answer["fit"]["steady_relative_error_after"] < 0.5 * answer["fit"]["steady_relative_error_before"]
