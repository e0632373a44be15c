"""STOP pressed in the page, and when the stage is told to move back: the drivers on emulated devices in real time.

``MESOTAP_STOPS`` sets how often (``make console-stop``: 50); the times are printed, and judged where they are many.
"""

from __future__ import annotations

import os
import random
import re
import statistics
from datetime import datetime
from pathlib import Path

import pytest

from tests.mesotap.console.consoles import console_in, needs_chromium
from tests.mesotap.console.pages import begin, clicked_at, opened, reach
from tests.mesotap.session.separate import CONFIG

STOPS = int(os.environ.get("MESOTAP_STOPS", "1"))
MANY = 20
ALLOWED_S = 0.1
BACK_MM = 0.05  # half of rig.limits.clearance_um; no step towards contact turns back so far
WIRE = re.compile(r"^(\S+Z) DEBUG mesotap\.wire micrometer stage on \S+ write ([0-9a-f]+)")
STATES = ("approaching", "setting the load", "locking", "tapping")

pytestmark = [needs_chromium, pytest.mark.slow]


def written(folder: Path) -> list[tuple[float, str]]:
    """What was written to the stage, with when, s since 1970."""
    found = []
    for log in folder.glob("*/session.log*"):
        for line in log.read_text().splitlines():
            if match := WIRE.match(line):
                at = datetime.fromisoformat(match[1].replace("Z", "+00:00")).timestamp()
                found.append((at, bytes.fromhex(match[2]).decode().strip()))
    return sorted(found)


def after_stop(commands: list[tuple[float, str]], pressed: float) -> tuple[float, float]:
    """Seconds from STOP to the next word to the stage, and until it is told to go back far."""
    place, first = None, None
    for at, command in commands:
        move = re.fullmatch(r"1PA(-?[\d.]+)", command)
        if at >= pressed:
            first = at if first is None else first
            if move and place is not None and float(move[1]) < place - BACK_MM:
                return first - pressed, at - pressed
        if move:
            place = float(move[1])
    raise AssertionError("it was never told to go back")


def test_stop_is_on_the_wire(chromium, tmp_path):
    rng = random.Random(21)
    after: list[tuple[str, float, float]] = []
    # so many taps that the session does not end before the last STOP, and a lock that lasts until it is seen
    more = ("--set", f"mesotap.impacts_per_load={max(2, STOPS)}", "--set", "mesotap.dwell_s=3")
    with console_in(tmp_path, "--log-wire", "--seed", "3", *more, config=CONFIG, rig="--emulate") as console:
        page = opened(chromium, console)
        begin(page)
        for i in range(STOPS):
            state = "approaching" if i % 2 == 0 else STATES[1 + i // 2 % 3]
            reach(page, state)
            page.wait_for_timeout(rng.uniform(0, 400))
            pressed = clicked_at(page, lambda: page.click("#stop"))
            reach(page, "ended")
            assert "the surfaces are apart" in page.text_content("#alert")
            after.append((state, *after_stop(written(console.sessions), pressed)))
            if i + 1 < STOPS:
                page.click("button.resume")
    for state, first, back in after:
        words, moved = f"next word to the stage {first * 1e3:4.0f} ms", f"told to go back {back * 1e3:4.0f} ms later"
        print(f"{state:18s} {words}, {moved}")
    backs = [back for _, _, back in after]
    print(f"{len(backs)} STOPs: median {statistics.median(backs) * 1e3:.0f} ms, worst {max(backs) * 1e3:.0f} ms")
    assert len(backs) < MANY or max(backs) <= ALLOWED_S
