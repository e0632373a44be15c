"""The pictures of docs/console, taken of sessions that run: ``python -m tests.mesotap.console.pictures [NAME ...]``."""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from PIL import Image

from sim_backend.emulators.bench_process import Devices
from tests.mesotap.console.consoles import CHROMIUM, FLAGS, ConsoleProcess, console_in
from tests.mesotap.console.pages import begin, opened, reach, shows
from tests.mesotap.session.separate import CONFIG

FOLDER = Path("docs/console")
SCREEN = {"width": 1280, "height": 800}
TABLET = {"width": 512, "height": 683}
"""768 by 1024 pixels at 150 %."""

COLOURS = 128
LARGEST_BYTES = 120_000
PAINTED_MS = 500

BENCH = """# config.yaml of the bench in room 12
mesotap:
  operator: A. Weber
  specimen: flat 17-4PH on 17-4PH, ground and polished
  title: Normal contact stiffness, dry
  load_plan_mn: [300, 600, 900]
  impacts_per_load: 8
  dwell_s: 20.0       # rest before the first tap
  diagnose: true
calibration: {weights_mn: [0, 200, 400, 600, 800, 1000], averaging_s: 0.5}
daq: {trigger: {record_samples: 4000}}
rig: {limits: {expected_contact_um: 30}}
sim_backend:
  contact_position_um: 30
  gauge: {weight_settling_s: 1.0}
  bad_taps: {double: 0.15, too_hard: 0.05, too_weak: 0, off_centre: 0, clipped: 0}
"""
EARLIER = ("--speed", "60", "--set", "mesotap.load_plan_mn=[300, 600, 900]", "--set", "mesotap.diagnose=false")
LEANT_UM = 8.0
HAMMER = ("--scope", "--set", "rig.wiring.hammer={input: 3}")
RUNG_OUT_MS = 3000.0
"""After which the trace begins anew at the next tap."""
SCOPE_TAPS, SCOPE_HEIGHT = 5, 1950  # down to the end of what the hammer shows


class Album:
    """Takes pictures of pages and keeps them small; with names given, those only."""

    def __init__(self, wanted: list[str]) -> None:
        self._wanted = wanted

    def take(self, page: Any, name: str, painted_ms: float = PAINTED_MS) -> None:
        """Take one of what the page shows."""
        page.wait_for_timeout(painted_ms)
        if self._wanted and name not in self._wanted:
            return
        taken = Image.open(io.BytesIO(page.screenshot(animations="disabled"))).convert("RGB")
        path = FOLDER / f"{name}.png"
        taken.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
        size = path.stat().st_size
        print(f"{path}: {size / 1000:.0f} kB")
        assert size < LARGEST_BYTES, path


def view(page: Any, name: str) -> None:
    """Turn to one of the pages."""
    page.click(f"nav a[href='#{name}']")
    page.evaluate("scrollTo(0, 0)")


def of_a_session(album: Album, chromium: Any, console: ConsoleProcess) -> None:
    """Take a session from its beginning to its diagnosis."""
    page = opened(chromium, console)
    page.set_viewport_size(SCREEN)
    page.wait_for_selector("#run:enabled")
    album.take(page, "session")
    begin(page)
    view(page, "calibration")
    shows(page, "#calibration-words", "([6-9]|1[0-2]) readings")
    album.take(page, "calibration-before")
    view(page, "session")
    for words, name in (("approaching", "approach"), ("setting the load", "load"), ("locking", "lock")):
        reach(page, words)
        album.take(page, name, 0)
    hand_over(album, page)
    view(page, "taps")
    page.wait_for_selector("#row .bad")
    page.click("#row .bad")
    shows(page, "#verdict", "not used")
    album.take(page, "tap-rejected")
    page.locator("#row .good").nth(3).click()
    shows(page, "#tap-kc", r"\d ±")
    album.take(page, "taps")
    page.click("#theme")
    album.take(page, "dark")
    page.click("#theme")
    page.wait_for_function(
        "() => document.querySelector('#plan, #row') && document.querySelector('#target').textContent === '600'"
    )
    view(page, "session")
    reach(page, "locking")
    page.click("#stop")
    reach(page, "ended")
    page.wait_for_selector("button.resume")
    album.take(page, "stopped")
    page.click("button.resume")
    reach(page, "working out the diagnosis")
    album.take(page, "diagnosing")
    reach(page, "done")
    at_the_end(album, page)
    tablet(album, chromium, page)


def hand_over(album: Album, page: Any) -> None:
    """Have another page ask for control, and be given none."""
    other = page.context.new_page()
    other.goto(page.url)
    other.click("#control")
    page.wait_for_selector("text=Hand control to page 2")
    album.take(page, "hand-over")
    other.close()


def at_the_end(album: Album, page: Any) -> None:
    """Take what there is to see of finished sessions."""
    view(page, "calibration")
    page.wait_for_selector("#drift:not([hidden])")
    album.take(page, "calibration-after")
    view(page, "loads")
    page.wait_for_selector("iframe[title='Diagnosis of this session']")
    album.take(page, "loads")
    for name, title in (("report", "Report of this session"), ("diagnosis", "Diagnosis of this session")):
        frame = page.locator(f"iframe[title='{title}']")
        frame.evaluate("(e) => scrollTo(0, e.parentElement.offsetTop - document.querySelector('header').offsetHeight)")
        page.frame_locator(f"iframe[title='{title}']").locator("h1").first.wait_for()
        album.take(page, name)
    view(page, "sessions")
    page.wait_for_selector("#past tbody tr >> nth=1")
    for box in page.locator("#past input[type=checkbox]").all():
        box.check()
    page.click("#compare")
    page.wait_for_selector("#compared tbody tr")
    album.take(page, "sessions")
    view(page, "settings")
    page.fill("[name='mesotap.dwell_s']", "-3")
    page.press("[name='mesotap.dwell_s']", "Tab")
    shows(page, "#outcome", r"dwell_s is -3")
    page.evaluate("scrollTo(0, 0)")
    album.take(page, "settings-wrong")
    page.fill("[name='mesotap.dwell_s']", "30")
    page.press("[name='mesotap.dwell_s']", "Tab")
    shows(page, "#outcome pre", r"\+.*dwell_s: 30")
    page.evaluate("scrollTo(0, 0)")
    album.take(page, "settings")


def tablet(album: Album, chromium: Any, page: Any) -> None:
    """Take the taps as a tablet shows them at 150 %."""
    context = chromium.new_context(viewport=TABLET, device_scale_factor=1.5, storage_state=page.context.storage_state())
    small = context.new_page()
    small.goto(page.url.partition("#")[0] + "#taps")
    shows(small, "#tap-kc", r"\d ±")
    album.take(small, "tablet")
    context.close()


def of_an_alarm(album: Album, chromium: Any, console: ConsoleProcess) -> None:
    """Take the alarm of a load over its limit, on emulated devices that somebody leans on."""
    page = opened(chromium, console)
    page.set_viewport_size(SCREEN)
    begin(page)
    reach(page, "locking")
    (folder,) = [p for p in console.sessions.iterdir() if p.is_dir()]
    devices = Devices(Path(json.loads((folder / "session.json").read_text())["devices"]))
    devices.call("push", LEANT_UM)
    reach(page, "ended")
    page.wait_for_selector("button.resume")
    album.take(page, "alarm")
    devices.call("end")
    devices.close()


def an_earlier_one(chromium: Any, console: ConsoleProcess) -> None:
    """Have a session to compare with."""
    page = opened(chromium, console)
    begin(page, specimen="flat 17-4PH on 17-4PH, as ground")
    reach(page, "done")


def of_the_scope(album: Album, chromium: Any, console: ConsoleProcess) -> None:
    """Take the live view after some taps with a hammer."""
    page = opened(chromium, console)
    page.set_viewport_size(SCREEN | {"height": SCOPE_HEIGHT})
    page.click("#begin:enabled")
    shows(page, "#next", "Quiet enough for a session")
    page.select_option("select[name=mode]", "tap")
    for number in range(SCOPE_TAPS):
        page.click("#tap")
        shows(page, ".response-taps", rf"^{number + 1} tap")
        page.wait_for_timeout(RUNG_OUT_MS)
    page.evaluate("scrollTo(0, 0)")
    album.take(page, "scope")
    page.click("#end")


@contextlib.contextmanager
def folder() -> Iterator[Path]:
    """A folder that is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="mesotap-pictures-") as name:
        yield Path(name)


def main(wanted: list[str]) -> None:
    """Take those wanted, or all."""
    from playwright.sync_api import sync_playwright

    album = Album(wanted)
    alarm: Callable[[], bool] = lambda: not wanted or "alarm" in wanted  # noqa: E731
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        if not wanted or "scope" in wanted:
            with folder() as path, console_in(path, *HAMMER, config=BENCH) as console:
                of_the_scope(album, chromium, console)
        if not wanted or {*wanted} - {"alarm", "scope"}:
            with folder() as path:
                with console_in(path, *EARLIER, config=BENCH) as console:
                    an_earlier_one(chromium, console)
                with console_in(path, "--speed", "5", "--seed", "4", config=BENCH) as console:
                    of_a_session(album, chromium, console)
        if alarm():
            with (
                folder() as path,
                console_in(path, "--set", "mesotap.dwell_s=600", config=CONFIG, rig="--emulate") as console,
            ):
                of_an_alarm(album, chromium, console)
        chromium.close()


if __name__ == "__main__":
    main(sys.argv[1:])
