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
from tests.mesotap.test_cli import mesotap, refused

KC, CC = 8.0e6, 40.0
LIGHT = ((356.36, 0.0025), (1768.9, 0.0046))  # Hz and damping ratio


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


def _ringing_on(rng: np.random.Generator, hits: int, apart_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Force, and two masses by the closed form of their impulse response; they still ring when the next hit comes."""
    n = round((0.05 + hits * apart_s) * RATE)
    t = np.arange(n) / RATE
    force = np.zeros(n)
    for i in range(hits):
        at = (t - 0.05 - i * apart_s) / 3e-4
        force += 20.0 * np.where((at >= 0) & (at <= 1), np.sin(np.pi * at), 0.0)
    response = []
    for shape in (-1.0, 1.0):
        impulse = np.zeros(n)
        for sign, (f, zeta) in ((1.0, LIGHT[0]), (shape, LIGHT[1])):
            pole = 2 * np.pi * f * (-zeta + 1j * np.sqrt(1 - zeta**2))
            impulse += sign * (pole**2 * np.exp(pole * t) / (1j * pole.imag)).real / (M1 + M2)
        felt = np.fft.irfft(np.fft.rfft(force, 2 * n) * np.fft.rfft(impulse, 2 * n))[:n] / RATE
        felt += (1 + shape) * force / (M1 + M2)  # an acceleration follows its force at once
        response.append(felt + 0.05 * rng.standard_normal(n) + 0.02)
    return force + 0.01 * rng.standard_normal(n), np.array(response)


def test_modes_of_several_hits_are_those_of_one_decay_and_ringing_at_the_next_is_told(tmp_path) -> None:
    force, (upper, lower) = _ringing_on(np.random.default_rng(11), 5, 0.41)
    path = _written(tmp_path / "n.csv", ["hammer [N]", "upper [m/s2]", "lower [m/s2]"], [force, upper, lower])
    answer = _responses(path, tmp_path)
    assert len(answer["modes"]) == 2
    for mode, (f, zeta) in zip(answer["modes"], LIGHT, strict=True):
        for quantity, true in (("frequency_hz", f), ("damping_ratio", zeta)):
            found = mode[quantity]
            assert abs(found["value"] - true) < found["high"] - found["low"]  # four standard errors
    assert any("was left of one hit when the next one came" in note for note in answer["frequency_response"]["notes"])


def test_hits_that_are_far_apart_are_not_said_to_ring(tmp_path) -> None:
    force, (upper, lower) = _ringing_on(np.random.default_rng(12), 3, 1.3)
    path = _written(tmp_path / "n.csv", ["hammer [N]", "upper [m/s2]", "lower [m/s2]"], [force, upper, lower])
    found = _responses(path, tmp_path)["frequency_response"]
    assert not any("was left of one hit" in note for note in found["notes"])
    # far below f1 the acceleration of both is that of their springs, and small: the offset is not in it
    f, h = np.array(found["frequency_hz"]), np.array(found["h1"])[:, :, 0] + 1j * np.array(found["h1"])[:, :, 1]
    s = 2j * np.pi * f
    for channel, shape in enumerate((-1.0, 1.0)):
        true = np.zeros_like(s)
        for sign, (f0, zeta) in ((1.0, LIGHT[0]), (shape, LIGHT[1])):
            true = true + sign * s**2 / (s**2 + 2 * zeta * (2 * np.pi * f0) * s + (2 * np.pi * f0) ** 2) / (M1 + M2)
        band = (f > 200) & (f < 300)
        assert np.abs(h[channel, band]) == pytest.approx(np.abs(true[band]), rel=0.05)


@pytest.mark.parametrize("fault", ["dead", "two"])
def test_forces_that_give_no_response_are_no_motions_either(tmp_path, samples, fault) -> None:
    force, (_, lower) = samples
    columns = [0 * force, lower] if fault == "dead" else [force, force, lower]
    heads = ["hammer [N]", "lower [m/s2]"] if fault == "dead" else ["hammer [N]", "cell [N]", "lower [m/s2]"]
    answer = _responses(_written(tmp_path / "x.csv", heads, columns), tmp_path)
    assert "frequency_response" not in answer
    assert all(len(mode["shape"]) == 1 for mode in answer["modes"])


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


def test_a_force_that_says_neither_name_nor_unit_is_told_to_look_like_one(tmp_path):
    t = np.arange(4000) / 5000.0
    noise = np.random.default_rng(1).normal(size=(2, t.size))
    push = np.where(t < 3e-3, 30 * np.sin(np.pi * t / 3e-3) ** 2, 0.0) + 0.01 * noise[0]
    decay = np.exp(-8 * t) * np.sin(2 * np.pi * 120 * t) + 1e-4 * noise[1]
    np.savetxt(tmp_path / "tap.csv", np.column_stack([t, push, decay]), delimiter=",")
    said = mesotap("analyze", tmp_path / "tap.csv").stdout
    assert "channel column2 is short pushes of one sign" in said
    assert "with --force column2 it is the force" in said
    np.savetxt(tmp_path / "two.csv", np.column_stack([t, decay, 0.5 * decay]), delimiter=",")
    assert "short pushes" not in mesotap("analyze", tmp_path / "two.csv").stdout


def test_a_decay_beyond_the_recording_is_refused_beside_a_force_too(both_seen):
    refused = mesotap("analyze", both_seen, "--decay-from", 99, code=2)
    assert "cannot begin at 99 s: the recording is" in refused.stderr
    assert "--decay-from" in refused.stderr


def test_a_recording_without_any_noise_has_no_warning(tmp_path):
    t = np.arange(4000) / 5000.0
    decay = np.exp(-8 * t) * np.sin(2 * np.pi * 120 * t) + np.exp(-20 * t) * np.sin(2 * np.pi * 700 * t)
    np.savetxt(
        tmp_path / "clean.csv", np.column_stack([t, decay]), delimiter=",", header="time,a", comments="", fmt="%.17g"
    )
    done = mesotap("analyze", tmp_path / "clean.csv")
    assert done.stderr == ""
    assert "120.0068 ± 0.0057" in done.stdout  # the clock of the recorder is all that it is uncertain by


@pytest.fixture(scope="module")
def both_seen(tmp_path_factory):
    """Five hits in one recording: the force, the struck mass and the other one, far from those of the configuration."""
    records = hits(np.random.default_rng(4), 7e6, 15.0, count=5, m1=0.15, m2=0.08, samples=10_000, seen=(0, 1))
    force = np.concatenate([r.force for r in records])
    struck, other = np.concatenate([r.response for r in records], axis=1)
    table = np.column_stack([np.arange(force.size) / RATE, force, other, struck])
    file = tmp_path_factory.mktemp("driving") / "hits.csv"
    np.savetxt(file, table, delimiter=",", header="time [s],push [N],low [m/s2],up [m/s2]", comments="", fmt="%.9g")
    return file


def test_the_driving_point_tells_both_masses_apart(both_seen, tmp_path):
    said = mesotap("analyze", both_seen, "--driving-point", "up", "--json", tmp_path / "a.json").stdout
    found = json.loads((tmp_path / "a.json").read_text())["driving_point"]
    assert (found["channel"], found["other"], found["hits"]) == ("up", "low", 5)
    for name, true in (("struck_mass_kg", 0.15), ("other_mass_kg", 0.08), ("contact_stiffness_n_per_m", 7e6)):
        assert found[name]["value"] == pytest.approx(true, rel=5e-3), name
        assert found[name]["low"] < found[name]["value"] < found[name]["high"], name
    assert "up on the mass struck, low on the other" in said
    assert "the uncertainty of the sensitivities is not in these intervals" in said


def test_the_unknown_ratio_of_the_springs_is_in_the_intervals_of_the_masses(both_seen, tmp_path):
    truth = {"struck_mass_kg": 0.15, "other_mass_kg": 0.08, "contact_stiffness_n_per_m": 7e6}

    def holding(percent: float) -> list[str]:
        springs = ("--set", "rig.springs={k1_n_per_m: 470000, k2_n_per_m: 606000}")  # in truth they are alike
        changes = (*springs, "--set", f"analysis.spring_asymmetry_percent={percent}")
        mesotap("analyze", both_seen, "--driving-point", "up", *changes, "--json", tmp_path / "a.json")
        found = json.loads((tmp_path / "a.json").read_text())["driving_point"]
        assert any("with k1 10 % stiffer against k2 the mass struck would come out" in n for n in found["notes"])
        return [name for name, true in truth.items() if found[name]["low"] < true < found[name]["high"]]

    assert not {"struck_mass_kg", "other_mass_kg"} & set(holding(0))
    assert holding(15) == list(truth)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--driving-point", "nothing"), "--driving-point nothing: it has no such channel"),
        (("--driving-point", "push"), "is the force itself"),
    ],
)
def test_a_driving_point_that_is_none_is_refused(both_seen, options, said):
    assert said in refused("analyze", both_seen, *options)
