"""`mesotap catalog`: what it lists, writes and refuses."""

from __future__ import annotations

import csv
import json

import pytest

from mesotap.catalogue.indexing import update
from mesotap.catalogue.store import Catalogue
from mesotap.console.past import sessions_in
from tests.fuzz.session_folders import finished
from tests.mesotap.catalogue.lab import filed, results, session
from tests.mesotap.test_cli import mesotap, refused


@pytest.fixture
def lab(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    filed(tmp_path / "lab" / "dry", session("steel", seed=1))
    filed(tmp_path / "lab" / "worn", session("brass =cmd()", seed=2), results(k_c=9e6))
    (tmp_path / "lab" / "torn.h5").write_bytes(b"torn")
    return tmp_path / "lab"


def test_it_lists_everything_with_the_reason_where_something_is_wrong(lab, tmp_path):
    answer = json.loads(mesotap("catalog", lab, "--json", "-", "--csv", tmp_path / "t.csv").stdout)
    assert {s["name"]: s["state"] for s in answer["sessions"]} == {
        "dry": "complete",
        "worn": "complete",
        "torn.h5": "damaged",
    }
    assert next(s["reason"] for s in answer["sessions"] if s["name"] == "torn.h5")
    table = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert sorted(row["contact_stiffness_n_per_m"] for row in table) == ["", "5000000.0", "9000000.0"]
    assert (tmp_path / "cache" / "mesotap" / "catalogue.sqlite").is_file()


def test_a_question_finds_and_says_what_it_could_not_judge(lab):
    mesotap("catalog", lab)
    answer = json.loads(mesotap("catalog", "--kc", "8..", "--where", "-specimen:steel", "--json", "-").stdout)
    assert [s["name"] for s in answer["sessions"]] == ["worn"]
    assert [s["name"] for s in answer["not_judged"]] == ["torn.h5"]
    assert answer["update"] is None


def test_parquet_is_read_by_another_program(lab, tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    mesotap("catalog", lab, "--parquet", tmp_path / "t.parquet")
    table = pandas.read_parquet(tmp_path / "t.parquet")
    assert set(table["contact_stiffness_n_per_m"].dropna()) == {5e6, 9e6}
    assert set(table["name"]) == {"dry", "worn", "torn.h5"}


@pytest.mark.parametrize("asked", ["-title:x", "not specimen:steel", "-kc:9..", "-drifted:yes", "-(title:x or kc:1)"])
def test_what_cannot_be_read_is_not_found_by_what_it_is_not(lab, asked):
    mesotap("catalog", lab)
    answer = json.loads(mesotap("catalog", "--where", asked, "--json", "-").stdout)
    assert "torn.h5" not in [s["name"] for s in answer["sessions"]]
    assert [s["name"] for s in answer["not_judged"]] == ["torn.h5"]


@pytest.mark.parametrize("asked", ["-state:complete", "state:damaged", "-name:dry -name:worn"])
def test_what_is_known_of_a_session_that_cannot_be_read_finds_it(lab, asked):
    mesotap("catalog", lab)
    answer = json.loads(mesotap("catalog", "--where", asked, "--json", "-").stdout)
    assert [s["name"] for s in answer["sessions"]] == ["torn.h5"]


def test_one_session_is_one(lab):
    mesotap("catalog", lab)
    assert "1 session; loads" in mesotap("catalog", "--where", "name:dry").stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--where", "state:nonsense"], "state: is one of complete, unfinished, damaged, other format, moved, gone"),
        (["--where", "verdict:perhaps"], "verdict: is one of consistent, missing_physics"),
        (["--load", "much"], "load: takes a number or a range"),
        (["--where", "weather:fine"], "nothing to ask for"),
        (["nowhere"], "there is no such folder"),
        ([], "nothing is in the catalogue yet"),
    ],
)
def test_what_cannot_be_answered_is_refused(arguments, said, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert said in refused("catalog", *arguments)


def test_nothing_of_others_is_written_over(lab, tmp_path):
    (tmp_path / "mine.csv").write_text("my table")
    assert "is no table of sessions" in refused("catalog", lab, "--csv", tmp_path / "mine.csv")
    assert "is not a catalogue" in refused("catalog", lab, "--index", tmp_path / "mine.csv")
    assert (tmp_path / "mine.csv").read_text() == "my table"


def test_the_console_lists_the_same_with_and_without_it(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    finished(tmp_path / "lab" / "a")
    by_folder = sessions_in(tmp_path / "lab")[0].summary
    with Catalogue(tmp_path / "cache" / "mesotap" / "catalogue.sqlite") as catalogue:
        update(catalogue, [tmp_path / "lab"])
    by_catalogue = sessions_in(tmp_path / "lab")[0].summary
    assert {key: by_catalogue[key] for key in by_folder} == by_folder
    assert "verdict" in by_catalogue
    (tmp_path / "lab" / "a" / "results.json").write_text(json.dumps(results(calibration={"drifted": True})))
    assert sessions_in(tmp_path / "lab")[0].summary["drifted"] is True
