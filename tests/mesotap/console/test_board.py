"""What the pages are shown, part by part."""

from __future__ import annotations

import json

import pytest

from mesotap.console.board import DIAGNOSIS, REPORT, Board, session_id
from mesotap.console.frames import taken
from mesotap.operator.people import Filing

BEGUN = {
    "kind": "begun",
    "plan_mn": [300.0],
    "wanted": 2,
    "limit_mn": 1000.0,
    "force_limit": 0.5,
    "simulated": True,
    "load_set": 0,
}


@pytest.mark.parametrize("there", [(), (REPORT,), (REPORT, DIAGNOSIS)])
def test_a_finished_session_says_what_there_is_to_read(tmp_path, there):
    shown = {}
    board = Board(lambda part, frame: shown.update({part: taken(frame)[0]}), lambda frame: None)
    board.hear({**BEGUN, "folder": str(tmp_path)}, b"")
    assert not shown["state"]["reported"]
    for name in there:
        (tmp_path / name).write_text("<p>read</p>")
    board.hear({"kind": "ended", "how": "filed", "text": ""}, b"")
    state = shown["state"]
    assert state["state"] == "DONE"
    assert state["session"] == session_id(tmp_path)
    assert (state["reported"], state["diagnosed"]) == (REPORT in there, DIAGNOSIS in there)
    board.clear()
    assert not board.state["diagnosed"]


def test_while_it_is_filed_and_diagnosed_the_page_says_so(tmp_path):
    board = Board(lambda part, frame: None, lambda frame: None)
    board.hear({**BEGUN, "folder": str(tmp_path)}, b"")
    board.hear({"kind": "state", "state": "POST_CALIBRATION", "words": "calibrating after the test", "text": ""}, b"")
    said = []
    for step in Filing:
        board.hear({"kind": "filing", "step": step.name, "words": step.value, "text": "1 of 2"}, b"")
        assert (board.state["state"], board.state["words"], board.state["text"]) == ("FILE", step.value, "1 of 2")
        said.append(board.state["next"])
        (tmp_path / REPORT).write_text("<p>read</p>")
    assert len(set(said)) == len(Filing)
    assert board.state["reported"], "it can be read while the diagnosis is worked out"


def test_nothing_is_to_be_resumed_where_the_folder_is_gone(tmp_path):
    board = Board(lambda part, frame: None, lambda frame: None)
    said = []
    for folder in (tmp_path, tmp_path / "gone"):
        board.hear({**BEGUN, "folder": str(folder)}, b"")
        board.hear({"kind": "ended", "how": "failed", "text": "the disk says no"}, b"")
        said.append(board.state["next"])
    assert said[0].endswith("then 'Resume'.")
    assert "nothing to resume" in said[1]


def test_an_alarm_of_the_live_view_stands_until_it_has_ended():
    shown = {}
    board = Board(lambda part, frame: shown.update({part: taken(frame)}), lambda frame: None)
    board.state.update(viewing=True, viewed=True)
    board.hear({"kind": "picture", "next": "Tap once.", "points": 1}, b"\0" * 16)
    assert shown["picture"] == ({"part": "picture", "points": 1}, b"\0" * 16)
    assert (board.state["words"], board.state["next"]) == ("live view", "Tap once.")
    over = "load: 1200 mN is over the limit of 1100 mN"
    board.hear({"kind": "alarm", "text": f"{over}; the surfaces are taken apart"}, b"")
    assert shown["state"][0]["alarm"] == f"{over}; the surfaces are being taken apart"
    board.hear({"kind": "ended", "how": "failed", "text": f"{over}; the surfaces are apart"}, b"")
    board.gone(0, True)
    state = shown["state"][0]
    assert (state["alarm"], state["viewing"], state["ended"]["text"]) == ("", False, f"{over}; the surfaces are apart")
    assert state["next"].startswith("Take the surfaces apart, then begin")


@pytest.mark.parametrize("late", [False, True])
def test_what_the_guardian_says_is_shown_whether_it_speaks_before_or_after_the_end_is_seen(tmp_path, late):
    board = Board(lambda part, frame: None, lambda frame: None)
    board.hear({**BEGUN, "folder": str(tmp_path)}, b"")
    board.hear({"kind": "state", "state": "LOCK", "words": "locking", "text": "7 s left at 249 mN"}, b"")
    board.hear({"kind": "load", "mn": 249.0}, b"")
    line = "mesotap guardian: the program died; the surfaces are apart; 'mesotap resume' goes on"
    steps = [lambda: board.gone(-9, True), lambda: board.said(line)]
    for step in steps if late else reversed(steps):
        step()
    board.said("something else on standard error")
    text = "the session's process was killed; the guardian took over: the surfaces are apart"
    assert (board.state["ended"]["text"], board.state["next"]) == (text, "Resume the session.")
    assert (board.state["text"], board.load["mn"]) == ("", None)


def test_a_guardian_that_could_not_take_the_surfaces_apart_is_not_called_a_success():
    board = Board(lambda part, frame: None, lambda frame: None)
    board.gone(-9, True)
    assert "says so here" in board.state["ended"]["text"]
    board.said("mesotap guardian: the program died; not made safe: back the micrometer off by hand")
    assert board.state["ended"]["text"].endswith("not made safe: back the micrometer off by hand")
    assert board.state["next"] == "Look at the rig, then resume the session."


def test_a_simulated_rig_ends_with_the_process_that_was_killed():
    board = Board(lambda part, frame: None, lambda frame: None)
    board.gone(-9, False)
    assert board.state["ended"]["text"] == "the session's process was killed, and the simulated rig with it"


@pytest.mark.parametrize("journal", [b"", b"{", b'{"event": "safe"}\n', b'{"event": "safe", "reason": 1}\n'])
def test_a_session_that_ended_while_nothing_was_heard_of_it_was_not_killed(tmp_path, journal):
    board = Board(lambda part, frame: None, lambda frame: None)
    board.hear({**BEGUN, "folder": str(tmp_path)}, b"")
    (tmp_path / "journal.jsonl").write_bytes(journal)
    board.gone(1, True)
    assert board.state["ended"]["text"].endswith("heard nothing of it: session.log says how")
    reason = {"event": "safe", "reason": "the console hangs", "troubles": []}
    (tmp_path / "journal.jsonl").write_text(json.dumps({"event": "safe", "reason": "earlier", "troubles": []}) + "\n")
    with (tmp_path / "journal.jsonl").open("a") as more:
        more.write(json.dumps(reason) + "\n" + json.dumps({"event": "closed"}) + "\n")
    board.state["ended"] = None
    board.gone(1, True)
    assert board.state["ended"]["text"].endswith("heard nothing of it: the console hangs; the surfaces are apart")
