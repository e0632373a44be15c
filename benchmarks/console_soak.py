"""An hour of the console: does it grow, does a tap come late to the screen, does a slow watcher hold up the others?

``python -m benchmarks.console_soak [--minutes 60] [--speed 20]`` runs one simulated session after the other. A page in
Chromium drives and shows the taps; two watchers read all that comes, a third hardly anything. Exits with 1 if a limit
is passed.
"""

from __future__ import annotations

import argparse
import os
import secrets
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin

from mesotap.console.frames import taken
from tests.mesotap.console.consoles import CHROMIUM, FLAGS, Client, ConsoleProcess, client_of, console_in
from tests.mesotap.console.pages import opened

GROWTH_MB = 10.0
TAP_S, UPDATE_S = 0.3, 0.1
SHARE = 0.95
SLOW_READ_S = 2.0
LOOK_S = 0.5
SESSION = ("--set", "mesotap.impacts_per_load=8")
WARM_SHARE, LONGEST_WARM_S = 0.25, 300.0
"""Growth is counted from then on, when a session has been seen to its end and everything is loaded."""


@dataclass
class Watcher:
    """Reads what the console shows, all of it or hardly any; comes back if it is cut off.

    Attributes
    ----------
    late_s
        From when a load was heard by the console until it came here.
    """

    console: ConsoleProcess
    client: Client
    ended: threading.Event
    pause_s: float = 0.0
    late_s: list[float] = field(default_factory=list)
    frames: int = 0
    cut_off: int = 0

    def run(self) -> None:
        """Read until it is over."""
        while not self.ended.is_set():
            try:
                self._read()
            except (ConnectionClosed, OSError, TimeoutError):
                self.cut_off += not self.ended.is_set()
                self.ended.wait(LOOK_S)

    def _read(self) -> None:
        address = f"ws://127.0.0.1:{self.console.port}/ws?page={secrets.token_hex(16)}"
        with connect(
            address,
            additional_headers={"Cookie": self.client.cookie},
            origin=Origin(f"http://127.0.0.1:{self.console.port}"),
            max_size=2**26,
            max_queue=1 if self.pause_s else 64,
            ping_interval=None,  # it is the console that looks whether this end still reads
        ) as socket:
            first = True
            while not self.ended.is_set():
                try:
                    data = socket.recv(LOOK_S)
                except TimeoutError:
                    continue
                self.frames += 1
                message, _ = taken(data if isinstance(data, bytes) else data.encode())
                if message["part"] == "alive":
                    socket.send("here")
                if message["part"] == "load" and message["at"] is not None:
                    if not first:  # the first is what there was before it came
                        self.late_s.append(time.time() - message["at"])
                    first = False
                self.ended.wait(self.pause_s)


@dataclass(frozen=True)
class Size:
    """Memory of the page, after its garbage was collected, and of the server, MB."""

    page_mb: float
    server_mb: float


def sizes(devtools: Any, console: ConsoleProcess) -> Size:
    """Measure both."""
    devtools.send("HeapProfiler.collectGarbage")
    used = float(devtools.send("Runtime.getHeapUsage")["usedSize"])
    status = Path(f"/proc/{console.process.pid}/status").read_text()
    kb = next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS"))
    return Size(used / 1e6, float(kb) / 1e3)


def at_share(values: list[float]) -> float:
    """Return the value that 95 % do not pass."""
    return (
        statistics.quantiles(values, n=100, method="inclusive")[round(100 * SHARE) - 1]
        if len(values) > 1
        else float("nan")
    )


def soak(minutes: float, speed: float) -> bool:
    """Run sessions for that long, print what was measured; whether every limit was kept."""
    from playwright.sync_api import sync_playwright

    folder = Path(tempfile.mkdtemp(prefix="mesotap-soak-"))
    with sync_playwright() as playwright, console_in(folder, *SESSION, "--speed", f"{speed:g}") as console:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = opened(browser, console)
        page.wait_for_selector("#run:enabled")
        page.click("nav a[href='#taps']")
        devtools = page.context.new_cdp_session(page)
        client = client_of(page, console)
        ended = threading.Event()
        watchers = [Watcher(console, client, ended, pause) for pause in (0.0, 0.0, SLOW_READ_S)]
        threads = [threading.Thread(target=watcher.run, daemon=True) for watcher in watchers]
        for thread in threads:
            thread.start()
        begun, whole_s = time.monotonic(), 60 * minutes
        sessions = drive(page, lambda: time.monotonic() - begun < min(WARM_SHARE * whole_s, LONGEST_WARM_S))
        before = sizes(devtools, console)
        sessions += drive(page, lambda: time.monotonic() - begun < whole_s)
        after = sizes(devtools, console)
        taps = [tap["drawn_s"] for tap in in_page(page, "page.latency")]
        ended.set()
        for thread in threads:
            thread.join(10)
        faults = list(page.faults)
        browser.close()
    print(f"{minutes:g} min, {sessions} sessions at {speed:g} times the speed, 1 page that drives and 3 watchers")
    print(f"load average {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores; sessions are in {folder}")
    return judged(before, after, taps, watchers, faults)


def in_page(page: Any, what: str) -> Any:
    """Return what the page's module ``wire`` has."""
    return page.evaluate(f"async () => {{ const {{ page }} = await import('/static/wire.js'); return {what}; }}")


def post(page: Any, what: str) -> Any:
    """Have the page ask for something."""
    return page.evaluate(f"async () => (await import('/static/wire.js')).post('{what}', {{}})")


def drive(page: Any, goes_on: Callable[[], bool]) -> int:
    """Begin a session whenever none runs; return how many."""
    begun = 0
    while goes_on():
        if not in_page(page, "page.parts.state.running"):
            begun += bool(post(page, "run")["ok"])
        time.sleep(LOOK_S)
    return begun


def judged(before: Size, after: Size, taps: list[float], watchers: list[Watcher], faults: list[str]) -> bool:
    """Print a table, and whether each line of it is within its limit."""
    rows = [
        ("page's heap, growth, MB", after.page_mb - before.page_mb, GROWTH_MB),
        ("server's memory, growth, MB", after.server_mb - before.server_mb, GROWTH_MB),
        (f"tap on screen, 95 % of {len(taps)}, s", at_share(taps), TAP_S),
        *(
            (f"load at watcher {i}, 95 % of {len(watcher.late_s)}, s", at_share(watcher.late_s), UPDATE_S)
            for i, watcher in enumerate(watchers[:2], 1)
        ),
    ]
    good = not faults
    print(f"{'':44}{'measured':>10}{'limit':>8}")
    for name, value, limit in rows:
        kept = value <= limit
        good = good and kept
        print(f"{name:44}{value:10.3f}{limit:8g}  {'kept' if kept else 'PASSED'}")
    print(f"page's heap {after.page_mb:.1f} MB, server {after.server_mb:.1f} MB at the end")
    worst = max([0.0, *watchers[0].late_s, *watchers[1].late_s])
    print(f"worst: tap {max([0.0, *taps]):.3f} s, load {worst:.3f} s")
    slow = watchers[2]
    print(f"slow watcher: {slow.frames} frames read, another {watchers[0].frames}; it was cut off {slow.cut_off} times")
    for fault in faults:
        print(f"fault in the page: {fault}")
    return good


def main() -> None:
    """Soak, and exit with 1 if a limit is passed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--speed", type=float, default=20.0)
    asked = parser.parse_args()
    if CHROMIUM is None:
        sys.exit("there is no chromium on this machine")
    sys.exit(0 if soak(asked.minutes, asked.speed) else 1)


if __name__ == "__main__":
    main()
