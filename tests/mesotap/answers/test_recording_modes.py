"""What an answer about a recording that is no session says of its clock and of where it comes from."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mesotap import __version__
from tests.mesotap.configuration.test_usual_recordings import DECAY, T, Writer, as_csv, as_tdms, as_uff, run

PPM = 1e-6


def analysed(file: Path, *options: object) -> dict[str, Any]:
    answer = file.with_suffix(".json")
    done = run("analyze", file, "--json", answer, *options)
    assert done.exit_code == 0, done.output
    found: dict[str, Any] = json.loads(answer.read_text())
    return found


def half_width(answer: dict[str, Any]) -> float:
    (mode,) = answer["modes"]
    frequency = mode["frequency_hz"]
    return float((frequency["high"] - frequency["low"]) / 2 / frequency["value"])


@pytest.mark.parametrize("write", [as_csv, as_tdms, as_uff])
def test_no_frequency_is_better_than_the_clock(tmp_path: Path, write: Writer) -> None:
    file = write(tmp_path, np.array([DECAY, 0.5 * DECAY]))
    assumed, exact = analysed(file), analysed(file, "--clock-ppm", 0)
    assert half_width(exact) < 20 * PPM
    # 95 % of what lies evenly within +-50 ppm, and the noise
    assert half_width(assumed) == pytest.approx(np.hypot(47.5 * PPM, half_width(exact)), rel=0.03)
    (said,) = [note for note in assumed["notes"] if "clock" in note]
    assert "to within 50 ppm, as an NI 9234's is and any other's is assumed to be" in said


def test_a_channel_that_never_changes_leaves_the_others_what_they_tell(tmp_path: Path) -> None:
    noisy = np.array([DECAY, 0.5 * DECAY]) + np.random.default_rng(4).normal(0, 1e-3, (2, DECAY.size))
    alone = analysed(as_csv(tmp_path, noisy))
    columns = np.array([T, noisy[0], 0 * T, noisy[1]]).T
    np.savetxt(
        tmp_path / "still.csv", columns, delimiter=",", header="time [s],a [m/s2],x [m/s2],b [m/s2]", comments=""
    )
    still = analysed(tmp_path / "still.csv")
    (mode,), (same,) = still["modes"], alone["modes"]
    for told in ("frequency_hz", "damping_ratio"):
        assert list(mode[told].values()) == pytest.approx(list(same[told].values()), rel=1e-9)
    assert mode["amplitude"] == pytest.approx([same["amplitude"][0], 0.0, same["amplitude"][1]], rel=1e-6)
    assert len(mode["along_decay"]) == len(same["along_decay"]) > 2
    assert len(mode["shape"]) == 3
    assert any("zero throughout" in remark for remark in still["notes"])


def test_the_configuration_says_how_good_the_clock_is_too(tmp_path: Path) -> None:
    file = as_csv(tmp_path, np.array([DECAY, 0.5 * DECAY]))
    declared = analysed(file, "--set", "rig.wiring.clock_accuracy_ppm=500")
    assert half_width(declared) == pytest.approx(475 * PPM, rel=0.01)
    (said,) = [note for note in declared["notes"] if "clock" in note]
    assert "to within 500 ppm (" in said
    assert half_width(analysed(file, "--clock-ppm", 500)) == half_width(declared)


def test_it_can_be_said_where_the_decay_begins(tmp_path: Path) -> None:
    early = np.exp(-1500 * T) * np.sin(2 * np.pi * 300 * T)  # as far as one can tell an impact
    noise = 0.02 * np.random.default_rng(1).standard_normal((2, T.size))
    file = as_csv(tmp_path, np.array([DECAY, 0.5 * DECAY]) + early + noise)
    found = analysed(file)
    assert [round(mode["frequency_hz"]["value"], -1) for mode in found["modes"]] == [700]
    assert any("say when the free decay begins" in note for note in found["notes"])
    said = analysed(file, "--decay-from", 0)["modes"]
    assert [round(mode["frequency_hz"]["value"], -1) for mode in said] == [pytest.approx(380, abs=40), 700]
    assert "nan" not in run("analyze", file).output  # what ERA has not is no number
    beyond = run("analyze", file, "--decay-from", 99)
    assert "cannot begin at 99 s: the recording is" in str(beyond.exception)


def test_each_channel_has_its_own_unit_in_the_answer_and_on_the_page(tmp_path: Path) -> None:
    head = "time [s],top [m/s^2],laser [um/s],plain"
    columns = np.array([T, DECAY, 3 * DECAY, -2 * DECAY]).T
    np.savetxt(tmp_path / "mixed.csv", columns, delimiter=",", header=head, comments="")
    channels = analysed(tmp_path / "mixed.csv", "--report", tmp_path / "page")["channels"]
    assert channels == [
        {"name": "top", "unit": "m/s2"},
        {"name": "laser", "unit": "um/s"},
        {"name": "plain", "unit": ""},
    ]
    page = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    assert "<dt>Unit</dt><dd>m/s², um/s, not stated</dd>" in page
    assert "<th>top<small>m/s²</small></th><th>laser<small>um/s</small></th><th>plain<small></small></th>" in page
    assert all(file.name in page for file in (tmp_path / "page").glob("*.pdf"))


def test_an_answer_holds_date_hash_versions_and_configuration(tmp_path: Path) -> None:
    file = as_csv(tmp_path, np.array([DECAY, 0.5 * DECAY]))
    origin = analysed(file, "--clock-ppm", 7, "--report", tmp_path / "page")["provenance"]
    assert origin["sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()
    assert origin["file_changed"].endswith("Z")
    assert origin["analysed_with"]["mesotap"] == __version__
    assert origin["configuration"]["rig"]["wiring"]["clock_accuracy_ppm"] == 7
    assert json.loads((tmp_path / "page" / "modes.json").read_text())["provenance"] == origin
