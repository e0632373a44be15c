"""What the pages are shown, part by part."""

from __future__ import annotations

import pytest

from mesotap.console.board import DIAGNOSIS, REPORT, Board, session_id
from mesotap.console.frames import taken

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
