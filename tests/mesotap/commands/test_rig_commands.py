"""`mesotap rig init` and `mesotap rig check` at recordings by scipy's integrator."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from mesotap.cli import app
from mesotap.configuration.rig_files import load_rig
from tests.analysis.mismatch.recordings.described_rigs import RATE, SAMPLES, driven

runner = CliRunner()


@pytest.fixture(scope="module", name="driven")
def driven_file(tmp_path_factory):
    """A recording of a driven mass; nobody writes there."""
    u, x, _ = driven()
    y = x + 1e-3 * np.std(x) * np.random.default_rng(1).normal(size=SAMPLES)
    file = tmp_path_factory.mktemp("driven") / "driven.csv"
    np.savetxt(
        file, np.array([np.arange(SAMPLES) / RATE, u, y]).T, delimiter=",", header="time,drive,signal", comments=""
    )
    return file


def run(*arguments):
    return runner.invoke(app, list(map(str, arguments)), catch_exceptions=True)


def test_a_first_rig_is_written_that_can_be_told_and_begins_well(driven, tmp_path):
    file = tmp_path / "rig.yaml"
    written = run("rig", "init", driven, "-o", file)
    assert written.exit_code == 0
    assert "driven" in written.stdout
    rig = load_rig(file)
    assert [d.channel for d in rig.drives] == ["drive"]
    assert [(s.channel, s.sensor.quantity) for s in rig.seen] == [("signal", "displacement")]
    assert len(rig.arrangement.bodies) == 1
    checked = run("rig", "check", file, driven, "--json", "-")
    assert checked.exit_code == 0
    answer = json.loads(checked.stdout)
    assert answer["undetermined"] == []
    assert answer["missed"]["signal"] < 0.05
    assert answer["better_unknown"] == {}


def test_a_rig_file_is_never_overwritten(driven, tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text("mine")
    refused = run("rig", "init", driven, "-o", file)
    assert refused.exit_code != 0
    assert file.read_text() == "mine"


def test_a_place_that_cannot_be_written_is_told_before_the_recording_is_read(tmp_path):
    (tmp_path / "file").touch()
    for more in (
        ("-o", tmp_path / "file" / "rig.yaml"),
        ("-o", tmp_path / "r.yaml", "--json", tmp_path / "file" / "a"),
    ):
        refused = run("rig", "init", tmp_path / "none.csv", *more)
        assert "a part of the path is a file, not a folder" in str(refused.exception)
        assert not (tmp_path / "r.yaml").exists()


def test_what_these_sensors_cannot_tell_is_said_without_a_recording(tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text(
        "bodies: {a: 1, b: unknown}\n"
        "joints: [{between: [a, ground]}, {name: link, between: [a, b]}]\n"
        "sensors: [{channel: x, of: a, shows: velocity}]\n"
    )
    found = run("rig", "check", file)
    assert found.exit_code == 0
    assert "best the mass of b" in " ".join(found.stdout.split())


def test_other_constants_that_show_the_same_are_told(tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text(
        "bodies: {a: 1, b: 0.6}\njoints: [{name: foot, between: [a, ground]}, {name: neck, between: [b, a]}]\n"
        "inputs: [{channel: u, base_acceleration: true}]\nsensors: [{channel: x, of: b, shows: acceleration}]\n"
    )
    found = run("rig", "check", file, "--json", tmp_path / "out.json")
    said = " ".join(found.stdout.split())
    assert "can have another set of values, far from the first one, with which all channels show the same" in said
    assert "every unknown constant can be told" not in said
    assert set(json.loads((tmp_path / "out.json").read_text())["same_shown_by"]["factors"]) == {
        "stiffness of foot", "damping of foot", "stiffness of neck", "damping of neck",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("columns", "options", "sentence"),
    [
        ((0.0, 0.0), (), "no channel shows a motion"),
        ((1.0, 1.0), ("--input", "nothing"), "has no channel nothing"),
    ],
)
def test_recordings_that_tell_nothing_are_refused_in_a_sentence(tmp_path, columns, options, sentence):
    file = tmp_path / "recording.csv"
    t = np.arange(600) / 100.0
    table = np.array([t, columns[0] * np.sin(40 * t), columns[1] * np.cos(40 * t)]).T
    np.savetxt(file, table, delimiter=",", header="time,x,y", comments="")
    refused = run("rig", "init", file, "-o", tmp_path / "rig.yaml", *options)
    assert refused.exit_code != 0
    assert sentence in str(refused.exception)
    assert not (tmp_path / "rig.yaml").exists()


@pytest.mark.slow
def test_a_value_that_is_far_off_is_told_with_what_to_leave_free(driven, tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text(
        "bodies: {mass: 1}\n"
        "joints: [{between: [mass, ground]}]\n"
        "inputs: [{channel: drive, force_on: mass, gain: 1}]\n"
        "sensors: [{channel: signal, of: mass, shows: displacement}]\n"
    )
    found = run("rig", "check", file, driven)
    assert found.exit_code == 0
    assert "with an unknown gain of input 1" in " ".join(found.stdout.split())


def test_a_channel_in_mm_is_a_sensor_of_a_thousand_to_the_metre(tmp_path):
    file, rig = tmp_path / "decay.csv", tmp_path / "rig.yaml"
    t = np.arange(2000) / 100.0
    x = 8 * np.exp(-0.5 * t) * np.cos(25 * t) + 0.01 * np.random.default_rng(2).normal(size=t.size)
    np.savetxt(file, np.array([t, x]).T, delimiter=",", header="time [s],x [mm]", comments="")
    assert run("rig", "init", file, "-o", rig).exit_code == 0
    described = load_rig(rig)
    assert described.arrangement.declared()[described.seen[0].gain] == 1000.0


def test_a_response_without_its_input_is_told_to_need_it(driven, tmp_path):
    table = np.genfromtxt(driven, delimiter=",", skip_header=1)
    file = tmp_path / "response.csv"
    np.savetxt(file, table[:, [0, 2]], delimiter=",", header="time [s],a1 [m/s2]", comments="")
    written = run("rig", "init", file, "-o", tmp_path / "rig.yaml")
    assert "--input" in " ".join(written.stdout.split())


def test_a_decimal_comma_in_a_rig_is_told_as_one(tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text(
        "bodies: {a: 1, b: 0,4}\njoints: [{between: [a, ground]}]\nsensors: [{channel: x, of: a, shows: velocity}]\n"
    )
    refused = run("rig", "check", file)
    assert "decimal point" in str(refused.exception)


def test_a_recording_without_a_rig_is_told_to_need_one(driven):
    refused = run("diagnose", driven)
    assert "--rig" in str(refused.exception)


WRONG_GAIN = (
    "bodies: {mass: 1}\n"
    "joints: [{between: [mass, ground]}]\n"
    "inputs: [{channel: drive, force_on: mass, gain: 1.0e+4}]\n"
    "sensors: [{channel: signal, of: mass, shows: displacement}]\n"
)


@pytest.mark.slow
def test_a_rig_that_is_worse_than_predicting_zero_is_told_so_first_with_what_to_leave_free(driven, tmp_path):
    rig, answer, page = tmp_path / "rig.yaml", tmp_path / "answer.json", tmp_path / "page"
    rig.write_text(WRONG_GAIN.replace("joints", "springs").replace("ground]", "ground], stiffness: 50000"))
    found = run("diagnose", driven, "--rig", rig, "--json", answer, "--report", page)
    assert found.exit_code == 0
    first = next(line for line in found.stdout.splitlines() if not line.startswith("diagnosing:"))
    assert first.startswith("The linear rig as described is worse than predicting zero")
    content = json.loads(answer.read_text())
    assert (content["verdict"], content["fit"]["far_off"]) == ("unexplained", True)
    assert content["fit"]["worse_than_zero"].split(".")[0] in " ".join(
        page.joinpath("diagnosis.html").read_text().split()
    )


@pytest.mark.slow
def test_what_is_left_free_is_written_as_the_rig_file_has_it(driven, tmp_path):
    from analysis.mismatch.recordings.linear_rig import problem_of
    from analysis.mismatch.recordings.recorded import prepare
    from analysis.mismatch.recordings.start_check import left_free
    from daq.exchange import import_recording

    rig = tmp_path / "rig.yaml"
    rig.write_text(WRONG_GAIN)
    described = load_rig(rig)
    said = left_free(problem_of(described, [prepare(import_recording(driven), described)]))
    assert "write 'gain: unknown' for channel drive" in said
    rig.write_text(WRONG_GAIN.replace("1.0e+4", "unknown"))
    checked = run("rig", "check", rig, driven, "--json", "-")
    assert json.loads(checked.stdout)["missed"]["signal"] < 0.05  # as it is said, it is mended
