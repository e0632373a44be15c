"""`mesotap compare`: what it writes, draws and refuses, and that the console tells the same."""

from __future__ import annotations

import json
import shutil

import h5py
import pytest

from mesotap.catalogue.curves import STIFFNESS
from mesotap.console.past import comparison_of, sessions_in
from tests.fuzz.session_folders import finished
from tests.mesotap.catalogue.test_comparing import LOADS, results
from tests.mesotap.test_cli import mesotap, refused


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    place = tmp_path_factory.mktemp("lab")
    finished(place / "a")
    for name, ratio in (("a", 1.0), ("b", 1.02)):
        if name != "a":
            shutil.copytree(place / "a", place / name)
            with h5py.File(place / name / "session.h5", "r+") as file:
                file.attrs["title"] = "another day"
        answer = results([ratio * 1e6 * load**0.3 for load in LOADS])
        (place / name / "results.json").write_text(json.dumps(answer))
    return place


def test_it_tells_the_difference_draws_and_agrees_with_the_console(lab, tmp_path):
    arguments = ["compare", lab / "a", lab / "b" / "session.h5", "--figure", tmp_path / "f.png"]
    answer = json.loads(mesotap(*arguments, "--json", "-").stdout)
    mean = answer["differences"][0]
    assert (mean["quantity"], mean["of"], mean["load_mn"]) == (STIFFNESS, "ratio", None)
    assert mean["low"] < 1.02 < mean["high"]
    assert mean["p_value"] < 0.05
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")
    by_page = comparison_of(sorted(sessions_in(lab), key=lambda s: s.path))
    assert by_page["differences"] == answer["differences"]


def test_what_cannot_be_compared_is_refused(lab, tmp_path):
    assert "two sessions at least" in refused("compare", lab / "a")
    assert "named twice" in refused("compare", lab / "a", lab / "a" / "session.h5")
    assert "allowed are session" in refused("compare", lab / "a", lab / "b", "--by", "weather")
    assert "nothing to compare" in refused("compare", lab / "a", lab / "b", "--by", "specimen")
    assert "a figure is written as" in refused("compare", lab / "a", lab / "b", "--figure", tmp_path / "f.doc")


def test_a_copy_counts_once_in_a_group(lab, tmp_path):
    shutil.copytree(lab / "a", tmp_path / "again")
    done = mesotap("compare", lab / "a", tmp_path / "again", "--by", "title", code=2)
    assert f"{tmp_path / 'again'}: is a copy of {lab / 'a'} and left out" in done.stdout
    assert "two sessions at least" in done.stderr
