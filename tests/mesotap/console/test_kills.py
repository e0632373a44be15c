"""The console killed in every state: the surfaces are apart, and the session goes on with nothing lost.

On the emulated devices in real time, which outlive both. ``MESOTAP_CONSOLE_KILLS`` sets how many rounds of the states
(``make console-kills``: 10); in the suite two states are tried.
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest

from daq.journal import SessionFolder
from sim_backend.emulators.bench_process import Devices
from tests.mesotap.console.consoles import Client, ConsoleProcess
from tests.mesotap.console.plain_page import PlainPage
from tests.mesotap.session.separate import CONFIG, FILED

ROUNDS = int(os.environ.get("MESOTAP_CONSOLE_KILLS", "0"))
STATES = ["TAP", "APPROACH", "PRE_CALIBRATION", "SET_LOAD", "LOCK", "RETRACT", "POST_CALIBRATION"]
TRIED = [(state, 0.3 * (1 + i)) for i in range(ROUNDS) for state in STATES] or [("TAP", 0.3), ("APPROACH", 0.3)]
APART_S = 30.0
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


@pytest.mark.slow
@pytest.mark.parametrize(("state", "wait_s"), TRIED)
def test_killed_and_resumed(tmp_path, state, wait_s):
    console = ConsoleProcess(tmp_path, "--seed", "5", config=CONFIG, rig="--emulate")
    try:
        page = PlainPage(console, Client(console))
        assert page.post("run")[0] == 200
        page.reach(state)
        time.sleep(wait_s)
        (folder,) = [p for p in console.sessions.iterdir() if p.is_dir()]
        devices = Devices(Path(json.loads((folder / "session.json").read_text())["devices"]))
        killed = time.monotonic()
        console.kill()
        kept = accepted(folder)  # the folder is free: the session's process has ended
        loads = devices.call("loads", killed)
        assert devices.call("state")["load_mn"] == 0.0, "the load is still on"
        last = max((at for at, mn in loads if mn > 0.0), default=killed)
        print(f"{state}: apart {last - killed:.2f} s after the kill")
        devices.close()
    finally:
        console.close()
    console = ConsoleProcess(tmp_path, config=CONFIG, rig="--emulate")
    try:
        page = PlainPage(console, Client(console))
        (session,) = json.loads(page.client.request("GET", "/api/sessions")[2])["sessions"]
        if not session["done"]:
            assert page.post("resume", {"id": session["id"]})[0] == 200
            page.until(lambda: FILED in (folder / "journal.jsonl").read_text() or page.state["ended"] is not None)
        assert FILED in (folder / "journal.jsonl").read_text(), page.state
        page.close()
    finally:
        console.close()
    after = accepted(folder)
    assert after.items() >= kept.items(), "an accepted tap was lost or altered"
    assert len(after) == 4
