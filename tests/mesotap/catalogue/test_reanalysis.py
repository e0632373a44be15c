"""Sessions analysed again: older answers stay as they were, what changed is told, and what may have changed it."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from daq.errors import RecordingError
from mesotap.catalogue.curves import STIFFNESS
from mesotap.catalogue.reanalysis import changed
from tests.fuzz.session_folders import finished
from tests.mesotap.catalogue.lab import results
from tests.mesotap.test_cli import mesotap


def test_what_is_the_same_is_no_change_and_what_left_its_interval_is_told():
    assert changed(results(), results()) == ()
    assert changed(results(k_c=5e6), results(k_c=5e6 * (1 + 1e-8))) == ()
    (within,) = changed(results(k_c=5e6), results(k_c=5.02e6))
    assert (within.quantity, within.beyond, within.old, within.new) == (STIFFNESS, False, 5e6, 5.02e6)
    (beyond,) = changed(results(k_c=5e6), results(k_c=5.2e6))
    assert beyond.beyond is True


def test_a_number_that_is_new_or_missing_now_is_told():
    without = results()
    without["loads"][0][STIFFNESS] = None
    (lost,) = changed(results(), without)
    assert (lost.old, lost.new, lost.beyond) == (5e6, None, None)
    assert len(changed(results(), {**results(), "loads": []})) == 6
    with pytest.raises(RecordingError, match="not the results"):
        changed(results(), {"loads": [{}]})


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    place = tmp_path_factory.mktemp("recorded") / "s"
    finished(place)
    return place


def test_older_answers_stay_and_the_same_analysis_is_not_done_twice(recorded, tmp_path):
    folder = shutil.copytree(recorded, tmp_path / "lab" / "s")
    (tmp_path / "lab" / "torn.h5").write_bytes(b"torn")
    index = ("--index", tmp_path / "i.sqlite")
    out = tmp_path / "r.json"

    def again(*more: str, code: int = 0):
        mesotap("reanalyze", tmp_path / "lab", *index, *more, "--json", out, code=code)
        return {s["name"]: s for s in json.loads(out.read_text())["sessions"]}

    first = again(code=2)
    assert first["torn.h5"]["status"] == "refused"
    assert again(code=2)["s"]["done"] is False  # nor is it done the second time, and what is torn is still told
    assert first["s"]["status"] == "first"
    (written,) = folder.glob("reanalysis/*/results.json")
    answer = json.loads(written.read_text())
    value = answer["loads"][0][STIFFNESS]["value"]
    answer["loads"][0][STIFFNESS] = {"value": 1.1 * value, "low": 1.09 * value, "high": 1.11 * value}
    older = json.dumps(answer)
    (folder / "results.json").write_text(older)
    second = again("--where", "-state:damaged")
    assert second["s"]["done"] is False
    assert "0 of 2 sessions analysed now" in " ".join(
        mesotap("reanalyze", tmp_path / "lab", *index, "--where", "name:s").stdout.split()
    )
    assert [c["beyond"] for c in second["s"]["changes"]] == [True]
    assert second["s"]["causes"]["configuration"] == "not recorded with the older answer"
    other = again("--where", "name:s", "--set", "calibration.weights_mn=[0, 400, 1000]")
    assert other["s"]["done"] is True
    assert other["s"]["causes"]["configuration"] != "the same"
    assert len(list(folder.glob("reanalysis/*"))) == 2
    assert (folder / "results.json").read_text() == older
    (found,) = json.loads(mesotap("catalog", *index, "--where", "name:s", "--json", "-").stdout)["sessions"]
    assert found["answer"].startswith("reanalysis/")


def test_what_differs_from_the_analysis_before_is_told(recorded, tmp_path):
    folder = shutil.copytree(recorded, tmp_path / "s")
    index, out = ("--index", tmp_path / "i.sqlite"), tmp_path / "r.json"
    mesotap("reanalyze", folder, *index)
    (kept,) = folder.glob("reanalysis/*/provenance.json")
    then = json.loads(kept.read_text())
    kept.write_text(json.dumps({**then, "program_sha256": "0" * 64, "software": "mesotap 0.0.9"}))
    kept.parent.rename(kept.parent.with_name("earlier"))
    mesotap("reanalyze", folder, *index, "--json", out)
    (told,) = json.loads(out.read_text())["sessions"]
    assert told["status"] == "unchanged"
    assert told["causes"] == {
        "version": f"another (mesotap 0.0.9, now {then['software']})",
        "configuration": "the same",
        "data": "the same",
    }


def test_a_recording_of_another_rig_is_passed_over_beside_sessions_and_refused_by_itself(recorded, tmp_path):
    lab = tmp_path / "lab"
    shutil.copytree(recorded, lab / "s")
    times = np.arange(500) / 1000.0
    decay = np.exp(-5.0 * times) * np.sin(300.0 * times)
    lines = ["time [s],a [m/s^2],b [m/s^2]", *(f"{t},{y},{2 * y}" for t, y in zip(times, decay, strict=True))]
    (lab / "other.csv").write_text("\n".join(lines))
    mesotap("import", lab / "other.csv")
    index, out = ("--index", tmp_path / "i.sqlite"), tmp_path / "r.json"
    mesotap("reanalyze", lab, *index, "--json", out)
    told = {s["name"]: s["status"] for s in json.loads(out.read_text())["sessions"]}
    assert told == {"other.h5": "no session", "s": "first"}
    said = mesotap("reanalyze", lab / "other.h5", *index, "--json", out, code=2)
    assert "nothing that was asked for is a session of the tester" in " ".join(said.stderr.split())
