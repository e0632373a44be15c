"""The console killed in every state: the surfaces are apart, and the session goes on with nothing lost.

On the emulated devices in real time, which outlive both. ``MESOTAP_CONSOLE_KILLS`` sets how many rounds of the states
(``make console-kills``: 10); in the suite two states are tried.
"""

from __future__ import annotations

import json
import os
import random
import time
from pathlib import Path

import pytest

from daq.journal import SessionFolder
from mesotap.session.states import State
from rig import RigError
from sim_backend.emulators.bench_process import Devices
from tests.mesotap.console.consoles import Client, ConsoleProcess
from tests.mesotap.console.plain_page import PlainPage
from tests.mesotap.session.separate import CONFIG, FILED

ROUNDS = int(os.environ.get("MESOTAP_CONSOLE_KILLS", "0"))
STATES = [state.name for state in State if state is not State.DONE]
LONGEST_WAIT_S = {
    "CONNECT": 0.1,
    "PRE_CALIBRATION": 0.4,
    "POST_CALIBRATION": 0.4,
    "SET_LOAD": 0.4,
    "LOCK": 0.4,
    "TAP": 0.9,
    "RETRACT": 0.1,
    "FILE": 1.0,
}
"""Between a state and the kill: about as long as the state lasts."""

USUAL_WAIT_S = 3.0
LATER = [state for state in STATES if state in ("LOCK", "SET_LOAD", "TAP")]
"""Those that come again at the second load."""

TRIED = [(state, i) for i in range(ROUNDS) for state in STATES] or [("TAP", 0), ("APPROACH", 0)]
APART_S, REPORT_S = 60.0, 300.0
"""A machine that is very busy; how long it took is printed."""


def accepted(folder) -> dict[int, bytes]:
    """Accepted taps on the disk, once whoever works there has let go of it."""
    begun = time.monotonic()
    while True:
        try:
            with SessionFolder.open(folder) as opened:
                return {i.number: i.acceleration.tobytes() for i in opened.impacts() if i.accepted}
        except ValueError:
            assert time.monotonic() < begun + APART_S
            time.sleep(0.05)


def seen_apart(folder: Path, devices: Devices, killed: float) -> str:
    """See that the surfaces are apart, and return how long that took; of a session that was filed they were before."""
    try:
        loads, load_mn = devices.call("loads", killed), devices.call("state")["load_mn"]
    except RigError:
        assert FILED in (folder / "journal.jsonl").read_text()
        return "filed"
    assert load_mn == 0.0, "the load is still on"
    return f"apart {max((at for at, mn in loads if mn > 0.0), default=killed) - killed:.2f} s after the kill"


@pytest.mark.long
@pytest.mark.parametrize(("state", "turn"), TRIED)
def test_killed_and_resumed(tmp_path, state, turn):
    wait_s = random.Random(f"{state} {turn}").uniform(0, LONGEST_WAIT_S.get(state, USUAL_WAIT_S))
    console = ConsoleProcess(tmp_path, "--seed", "5", config=CONFIG, rig="--emulate")
    try:
        page = PlainPage(console, Client(console))
        assert page.post("run")[0] == 200
        page.reach(state)
        if state in LATER and turn % 2:
            page.until(lambda: page.state["load_set"] == 1 and page.state["state"] == state)
        time.sleep(wait_s)
        (folder,) = [p for p in console.sessions.iterdir() if p.is_dir()]
        devices = Devices(Path(json.loads((folder / "session.json").read_text())["devices"]))
        before = devices.call("state")["load_mn"]
        killed = time.monotonic()
        console.kill()
        kept = accepted(folder)  # the folder is free: the session's process has ended
        apart = seen_apart(folder, devices, killed)
        there = page.state["state"]
        print(f"killed in {there} ({state} and {wait_s:.2f} s) with {before:.0f} mN, {len(kept)} taps: {apart}")
        devices.close()
    finally:
        console.close()
    console = ConsoleProcess(tmp_path, config=CONFIG, rig="--emulate")
    try:
        page = PlainPage(console, Client(console))
        (session,) = json.loads(page.client.request("GET", "/api/sessions")[2])["sessions"]
        if not session["done"] or not session["report"]:
            assert page.post("resume", {"id": session["id"]})[0] == 200
            page.until(
                lambda: FILED in (folder / "journal.jsonl").read_text() or page.state["ended"] is not None, REPORT_S
            )
            page.until(lambda: not page.state["running"], REPORT_S)
        assert FILED in (folder / "journal.jsonl").read_text(), page.state
        assert (folder / "report.html").is_file()
        page.close()
    finally:
        console.close()
    after = accepted(folder)
    assert after.items() >= kept.items(), "an accepted tap was lost or altered"
    assert len(after) == 4
