"""`mesotap hits`, and sessions that take more taps than they use."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daq.hits import is_left_out
from daq.session_file import read_session
from mesotap.cli import app
from mesotap.commands import session as session_commands

CHANGES = ("mesotap.load_plan_mn=[400]", "mesotap.impacts_per_load=3", "mesotap.surplus_impacts=2", "mesotap.dwell_s=0")


def run(*arguments: object):
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("surplus") / "s"
    changes = [part for change in CHANGES for part in ("--set", change)]
    done = run("run", "--simulate", "--seed", 5, "-o", folder, *changes)
    assert done.exit_code == 0, done.output
    return folder / "session.h5"


def used(file: Path) -> list[int]:
    return [i.number for i in read_session(file).impacts if i.accepted]


@pytest.mark.slow
def test_surplus_taps_are_taken_and_the_best_are_used(session: Path) -> None:
    impacts = read_session(session).impacts
    assert sum(i.accepted for i in impacts) == 3
    left = [i for i in impacts if is_left_out(i)]
    assert len(left) == 2
    for impact in left:
        assert re.search(r"about [\d.]+ Hz it lacks \S+ in coherence with the 3 taps kept", impact.reject_reason)


def test_what_was_left_out_is_told_by_report_info_and_hits(session: Path, tmp_path: Path) -> None:
    left = [i for i in read_session(session).impacts if is_left_out(i)]
    assert run("info", session, "--json", tmp_path / "info.json").exit_code == 0
    told = json.loads((tmp_path / "info.json").read_text())["left_out"]
    assert [int(t.split()[0]) for t in told] == [i.number for i in left]
    assert run("hits", session, "--json", tmp_path / "hits.json").exit_code == 0
    taps = json.loads((tmp_path / "hits.json").read_text())["taps"]
    assert [t["number"] for t in taps if t["left_out"]] == [i.number for i in left]
    assert all(t["reason"] for t in taps if not t["used"])
    page = (session.parent / "report.html").read_text()
    for impact in left:
        assert impact.name in page
    assert "2 left out by the choice of hits" in page
    rejected = sum(not i.accepted for i in read_session(session).impacts) - 2
    assert f"{rejected} of {len(read_session(session).impacts)} rejected" in page
    assert f"<td>3 / {rejected}</td>" in page


def test_another_choice_goes_to_a_new_file_and_can_be_undone(session: Path, tmp_path: Path) -> None:
    before = session.read_bytes()
    left = [i.number for i in read_session(session).impacts if is_left_out(i)]
    kept = used(session)
    other, back = tmp_path / "other.h5", tmp_path / "back.h5"
    asked = ("--keep", left[0], "--drop", kept[0], "--reason", "the light was on")
    assert run("hits", session, *asked, "-o", other).exit_code == 0
    assert used(other) == sorted({*kept, left[0]} - {kept[0]})
    by_number = {i.number: i for i in read_session(other).impacts}
    assert by_number[kept[0]].reject_reason == "by hand: the light was on"
    assert by_number[left[0]].extra["overruled"].startswith("left out: ")
    assert run("hits", other, "--reset", "-o", back).exit_code == 0
    assert used(back) == sorted([*kept, *left])  # the verdicts of the recording
    assert run("hits", back, "--best", 3, "-o", tmp_path / "again.h5").exit_code == 0
    assert used(tmp_path / "again.h5") == kept
    assert session.read_bytes() == before


def test_one_decision_is_taken_back_and_the_others_stay(session: Path, tmp_path: Path) -> None:
    left = [i.number for i in read_session(session).impacts if is_left_out(i)]
    kept = used(session)
    decided, back, all_back = (tmp_path / f"{name}.h5" for name in ("decided", "back", "all-back"))
    asked = ("--keep", left[0], "--drop", kept[0], "--reason", "the light was on")
    assert run("hits", session, *asked, "-o", decided).exit_code == 0
    assert run("hits", decided, "--undo", left[0], "-o", back).exit_code == 0
    assert used(back) == kept[1:]
    before = {i.number: i for i in read_session(session).impacts}
    after = {i.number: i for i in read_session(back).impacts}
    assert after[left[0]].reject_reason == before[left[0]].reject_reason
    assert after[left[0]].extra == before[left[0]].extra
    assert run("hits", back, "--undo", kept[0], "-o", all_back).exit_code == 0
    assert used(all_back) == kept
    refused = run("hits", all_back, "--undo", kept[0], "-o", tmp_path / "new.h5")
    assert "nothing was decided by hand on tap" in str(refused.exception)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--best", "3"), "--output NEW.h5"),
        (("--keep", "99", "--reason", "x", "-o", "new.h5"), "has no tap 99"),
        (("--keep", "0", "-o", "new.h5"), "say why"),
        (("--keep", "0", "--drop", "0", "--reason", "x", "-o", "new.h5"), "both kept and dropped"),
        (("--undo", "99", "-o", "new.h5"), "has no tap 99"),
        (("--undo", "0", "-o", "new.h5"), "nothing was decided by hand on tap 0"),
        (("-o", "new.h5"), "nothing is to be written"),
    ],
)
def test_what_cannot_be_done_is_refused(session: Path, tmp_path: Path, options, said, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = run("hits", session, *options)
    assert done.exit_code != 0
    assert said in str(done.exception)
    assert not Path("new.h5").exists()


def test_more_than_there_are_is_told(session: Path, tmp_path: Path) -> None:
    done = run("hits", session, "--best", 100, "-o", tmp_path / "new.h5")
    assert done.exit_code == 0
    assert "load 1: has 5 good taps, fewer than --best 100: all are used" in done.stdout
    assert len(used(tmp_path / "new.h5")) == 5


def test_a_file_that_exists_is_left_alone(session: Path, tmp_path: Path) -> None:
    there = tmp_path / "there.h5"
    there.write_text("mine")
    assert run("hits", session, "--best", 2, "-o", there).exit_code != 0
    assert there.read_text() == "mine"


def test_without_surplus_every_good_tap_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_commands, "_report", lambda *arguments: None)
    monkeypatch.setattr(session_commands, "results_json", lambda results: {})
    changes = [part for change in (*CHANGES[:2], "mesotap.surplus_impacts=0", CHANGES[3]) for part in ("--set", change)]
    assert run("run", "--simulate", "--seed", 5, "-o", tmp_path / "s", *changes).exit_code == 0
    assert not any(is_left_out(i) for i in read_session(tmp_path / "s" / "session.h5").impacts)
