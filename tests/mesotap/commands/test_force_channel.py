"""Recordings of other programs with a force channel: found by its unit or named, each fault told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from daq.errors import RecordingError
from mesotap.cli import app
from mesotap.commands.files import analyze
from mesotap.commands.force_channel import ForceOptions
from tests.analysis.frequency_response.hits_of_two import M1, M2, RATE, hits

KC, CC = 8.0e6, 40.0


@pytest.fixture(scope="module")
def samples() -> tuple[np.ndarray, np.ndarray]:
    records = hits(np.random.default_rng(5), KC, CC, count=3, c=20.0, seen=(0, 1), samples=1500)
    return np.concatenate([r.force for r in records]), np.concatenate([r.response for r in records], axis=1)


def _written(path: Path, heads: list[str], columns: list[np.ndarray]) -> Path:
    t = np.arange(columns[0].size) / RATE
    header = ",".join(["time [s]", *heads])
    np.savetxt(path, np.column_stack([t, *columns]), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def _analyzed(*arguments: object) -> tuple[int, str]:
    found = CliRunner().invoke(app, ["analyze", *map(str, arguments)])
    return found.exit_code, found.output


def _refused(path: Path, *options: Any) -> None:
    analyze([path], None, None, None, (), None, None, Console(quiet=True), force=ForceOptions(*options))


def _responses(path: Path, tmp_path: Path, *options: object) -> dict:
    out = tmp_path / "answer.json"
    code, said = _analyzed(path, "--json", out, *options)
    assert code == 0, said
    return json.loads(out.read_text())


def test_a_channel_in_newtons_gives_frequency_responses_and_is_no_channel_of_the_modes(tmp_path, samples) -> None:
    force, (upper, lower) = samples
    path = _written(tmp_path / "n.csv", ["hammer [N]", "upper [m/s2]", "lower [m/s2]"], [force, upper, lower])
    answer = _responses(path, tmp_path)
    found = answer["frequency_response"]
    assert found["channels"] == ["upper", "lower"]
    assert found["unit"] == "m/s2/N"
    assert found["averages"] == 3
    assert len(answer["modes"][0]["shape"]) == 2
    # far above f1 and far below f2 both masses move as one: |H| is 1 / (m1 + m2), and a few percent of either mode
    f, h = np.array(found["frequency_hz"]), np.array(found["h1"][1])[:, 0]
    plateau = (f > 900) & (f < 1000)
    f1, f2 = (mode["frequency_hz"]["value"] for mode in answer["modes"][:2])
    both = f[plateau] ** 2 * (1 / (f[plateau] ** 2 - f1**2) - 1 / (f[plateau] ** 2 - f2**2)) / (M1 + M2)
    assert h[plateau] == pytest.approx(both, rel=0.02)


@pytest.mark.slow
def test_pounds_force_are_taken_as_newtons_and_said(tmp_path, samples) -> None:
    force, (_, lower) = samples
    one = _written(tmp_path / "n.csv", ["hammer [N]", "lower [m/s2]"], [force, lower])
    other = _written(tmp_path / "lbf.csv", ["hammer [lbf]", "lower [m/s2]"], [force / 4.4482216152605, lower])
    a, b = (_responses(path, tmp_path)["frequency_response"] for path in (one, other))
    assert np.array(b["h1"]) == pytest.approx(np.array(a["h1"]), rel=1e-4, abs=1e-6)
    assert any("was in lbf" in note for note in b["notes"])


@pytest.mark.slow
def test_a_channel_without_a_unit_is_named(tmp_path, samples) -> None:
    force, (_, lower) = samples
    path = _written(tmp_path / "x.csv", ["hammer", "lower [m/s2]"], [force, lower])
    assert "frequency_response" not in _responses(path, tmp_path)
    found = _responses(path, tmp_path, "--force", "hammer", "--window", "none")["frequency_response"]
    assert found["window"] == "no window"
    assert any("taken as newtons" in note for note in found["notes"])


def test_a_dead_force_costs_the_responses_and_not_the_modes(tmp_path, samples) -> None:
    force, (_, lower) = samples
    path = _written(tmp_path / "dead.csv", ["hammer [N]", "lower [m/s2]"], [0 * force, lower])
    code, said = _analyzed(path, "--json", tmp_path / "a.json")
    answer = json.loads((tmp_path / "a.json").read_text())
    assert code == 0
    assert answer["modes"]
    assert "frequency_response" not in answer
    assert "no frequency response: hammer: the force channel never changes" in said.replace("\n", " ")
    with pytest.raises(RecordingError, match="never changes"):
        _refused(path, "hammer")


@pytest.mark.parametrize(
    ("heads", "options", "said"),
    [
        (["hammer", "lower [m/s2]"], (None, "impact"), "say with --force which one"),
        (["hammer [N]", "cell [N]"], (None, None, 0.1), "are all forces"),
        (["hammer [N]", "lower [m/s2]"], ("9",), "has no such channel, only hammer, lower"),
        (["hammer [N]", "lower [m/s2]"], (None, "hamming"), "'hamming' is not known"),
        (["hammer [N]", "lower [m/s2]"], (None, None, 1e-6), "fewer than 64 samples"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(tmp_path, samples, heads, options, said) -> None:
    force, (_, lower) = samples
    path = _written(tmp_path / "x.csv", heads, [force, lower])
    with pytest.raises(RecordingError, match=said):
        _refused(path, *options)


@pytest.mark.slow
def test_the_page_shows_them(tmp_path, samples) -> None:
    force, (upper, lower) = samples
    path = _written(tmp_path / "n.csv", ["hammer [N]", "upper [m/s2]", "lower [m/s2]"], [force, upper, lower])
    assert _analyzed(path, "--report", tmp_path / "page")[0] == 0
    page = (tmp_path / "page" / "report.html").read_text()
    assert "Frequency response" in page
    assert "3 averages; the force excites up to" in page
    assert (tmp_path / "page" / "frequency-response.pdf").exists()
