"""``mesotap console --scope``: its page in Chromium, and what becomes of the rig when a process of it is killed."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import time
from pathlib import Path

import pytest

from rig import RigError
from sim_backend.emulators.bench_process import Devices
from tests.mesotap.console.consoles import Client, console_in, needs_chromium
from tests.mesotap.console.pages import opened, reach, shows
from tests.mesotap.console.plain_page import PlainPage
from tests.mesotap.session.separate import CONFIG

READY = "Quiet enough for a session"
PUSHED_UM, OVER_UM = 4.0, 12.0
"""How deep past the contact at 12 um somebody turns: to 0.4 N, and over the limit of 1.1 N."""


STALLED = "the last reading is"
"""A machine that stands still for half a second ends the view, as it must: a load that old is not known."""


def begun(page, tries: int = 3):
    """Begin the view, and wait until it shows what there is; again where the machine stood still meanwhile."""
    from playwright.sync_api import expect

    page.click("#begin:enabled")
    ended = page.locator("#alert:not([hidden])")
    expect(ended.or_(page.locator("#next", has_text=READY)).first).to_be_visible()
    if not ended.count():
        return
    told = ended.text_content()
    assert STALLED in told, told
    assert tries > 1
    begun(page, tries - 1)


@pytest.mark.long
@needs_chromium
def test_the_page_from_its_beginning_to_stop(chromium, tmp_path):
    from playwright.sync_api import expect

    with console_in(tmp_path, "--scope") as console:
        page = opened(chromium, console)
        assert [link.text_content() for link in page.locator("nav a").all()] == ["Scope", "Settings"]
        shows(page, "#next", "Take the surfaces apart, then begin")
        begun(page)
        shows(page, "#limit", "1100")
        shows(page, "#load-age", "just now")
        expect(page.locator("#levels tbody tr").last).to_contain_text("noise, m/s² rms✓ 0.001")
        shows(page, "#gates", "Full scale 49.0")
        # the average grows to what was asked for, and begins anew
        page.fill("input[name=averages]", "5")
        page.press("input[name=averages]", "Enter")
        shows(page, "#averaged", "^5 of 5 averaged")
        page.fill("input[name=averages]", "200")
        page.press("input[name=averages]", "Enter")
        shows(page, "#averaged", r"\d\d of 200 averaged")
        page.click("#reset")
        shows(page, "#averaged", "^[0-9] of 200 averaged")
        # pictures come (how many a second is printed, not judged: machines are busy), none while they are held
        count = "() => import('/static/wire.js').then((wire) => wire.page.pictures)"
        before, begun_s = page.evaluate(count), time.monotonic()
        while (now := page.evaluate(count)) < before + 20:
            page.wait_for_timeout(20)
        print(f"{(now - before) / (time.monotonic() - begun_s):.1f} pictures a second")
        page.click("#hold")
        held = page.evaluate(count)
        page.wait_for_timeout(500)
        assert page.evaluate(count) == held
        page.click("#hold")
        # the check
        page.click("#check-by-tap")
        shows(page, "#check", "wiring and polarity are right")
        shows(page, "#relation", r"equal.*correlation.*(0\.999|1\.000)\d.*gain of B over A.*(0\.99|1\.00)\d\d ± 0")
        # reloaded, it shows the same
        page.reload()
        shows(page, "#check", "wiring and polarity are right")
        # a second page watches: it sees the same, may not act, and may press STOP
        link = console_link(console, page)
        watcher = opened(chromium, console, link)
        shows(watcher, "#check", "wiring and polarity are right")
        expect(watcher.locator("#check-by-tap")).to_be_disabled()
        expect(watcher.locator("input[name=averages]")).to_be_disabled()
        watcher.keyboard.press("Space")
        for each in (page, watcher):
            reach(each, "ended")
            assert (
                each.text_content("#alert").lower() == "live view ended by stop in the console; the surfaces are apart"
            )
            assert each.faults == []
        begun(page)  # and it can begin again
        page.click("#end")
        shows(page, "#words", "no view")
        assert page.is_hidden("#alert")


def console_link(console, page):
    """Return a further one-time link."""
    ask = "() => import('/static/wire.js').then((wire) => wire.post('link', {}))"
    return f"http://127.0.0.1:{console.port}{page.evaluate(ask)['path']}"


@pytest.mark.slow
@needs_chromium
def test_the_hammer_on_the_smallest_screen_too(chromium, tmp_path):
    from playwright.sync_api import expect

    with console_in(tmp_path, "--scope", "--set", "rig.wiring.hammer={input: 3}") as console:
        page = opened(chromium, console)
        page.set_viewport_size({"width": 390, "height": 844})
        begun(page)
        expect(page.locator("#force canvas")).to_be_visible()
        shows(page, "#hammer", "No tap in the force channel yet")
        expect(page.locator(".responses")).to_be_hidden()
        for number in (1, 2):
            page.click("#tap")
            shows(page, ".response-taps", f"^{number} tap")
        shows(page, ".response-words", r"hammer 0\.\d+ N, excites to \d+ Hz; 2 taps: coherence (0\.\d\d|1\.00) or more")
        expect(page.locator(".responses canvas:visible")).to_have_count(3)
        drawn = page.evaluate(
            "() => [...document.querySelectorAll('.responses canvas')].map((c) => new Set(new Uint32Array("
            "c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer)).size)"
        )
        assert min(drawn) > 10, drawn
        shows(page, ".responses", "H1 takes noise of the accelerometers out")
        picture = "() => document.querySelectorAll('.responses canvas')[1].toDataURL()"
        by_h1 = page.evaluate(picture)
        page.select_option(".estimator", "h2")
        shows(page, ".responses", "It is H1 over the coherence")
        assert page.evaluate(picture) != by_h1
        page.select_option(".estimator", "h1")
        page.wait_for_function(f"(before) => ({picture})() === before", arg=by_h1)
        assert page.evaluate("() => document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        page.reload()
        shows(page, ".response-taps", "^2 taps")
        page.click("#drop")
        shows(page, ".response-taps", "^1 tap")
        page.click("#taps-anew")
        shows(page, "#hammer", "No tap in the force channel yet")
        assert page.faults == []


@pytest.mark.slow
@needs_chromium
def test_an_upside_down_sensor_is_named_with_what_to_change(chromium, tmp_path):
    with console_in(tmp_path, "--scope", "--set", "sim_backend.sensors.b.gain=-1") as console:
        page = opened(chromium, console)
        begun(page)
        page.click("#check-by-tap")
        shows(page, "#check", "1 of 9 to mend")
        shows(page, "#check", "B sees the tap upside down.*set rig.wiring.accelerometer_b.polarity to 1")
        shows(page, "#relation", "opposite.*-1.0000")
        shows(page, "#next", "Mend what the check found: polarity. Then check again.")
        assert page.faults == []


@pytest.mark.slow
@needs_chromium
def test_a_view_and_a_session_exclude_each_other(chromium, tmp_path):
    with console_in(tmp_path, "--speed", "20", "--set", "mesotap.dwell_s=100") as console:
        page = opened(chromium, console)
        page.click("nav a[href='#scope']")
        begun(page)
        page.click("nav a[href='#session']")
        shows(page, "main", "The live view runs")
        run = "(what) => import('/static/wire.js').then((wire) => wire.post(what, {}))"
        assert "the live view runs already" in page.evaluate(run, "run")["error"]
        page.click("nav a[href='#scope']")
        page.click("#end")
        page.click("nav a[href='#session']")
        page.click("#run")
        reach(page, "locking")
        assert "a session runs already" in page.evaluate(run, "view/begin")["error"]
        page.click("nav a[href='#scope']")
        assert page.is_disabled("#begin")
        page.click("#stop")
        reach(page, "ended")
        assert page.faults == []


@pytest.mark.slow
def test_what_no_page_sends_is_refused(tmp_path):
    with console_in(tmp_path, "--scope") as console:
        page = PlainPage(console, Client(console))
        show = {"averages": 16, "span_ms": 50, "triggered": False, "level": 0.05}
        assert page.post("view/show", show) == (400, {"error": "no live view runs: begin it first"})
        assert page.post("view/begin")[0] == 200
        page.until(lambda: "picture" in page.parts)
        for wrong in (
            {"averages": 0}, {"averages": 201}, {"averages": 1e999}, {"averages": "many"}, {"averages": None},
            {"span_ms": 51}, {"span_ms": -50}, {"span_ms": [50]}, {"triggered": 1}, {"triggered": "true"},
            {"level": 0}, {"level": -1}, {"level": 1e999}, {"level": "NaN"}, {"level": 1e9},
        ):  # fmt: skip
            assert page.post("view/show", {**show, **wrong})[0] == 400, wrong
        for side in ("", "c", "__class__", 1, None, ["a"]):
            assert page.post("view/check", {"side": side})[0] == 400
        assert page.post("view/check")[0] == 400
        assert page.post("run")[0] == 400  # it runs no session
        assert page.post("pause")[0] == 400
        assert page.post("view/begin")[0] == 400  # it runs already
        page.until(lambda: page.parts["picture"]["count"] > 3)
        assert (page.parts["picture"]["averages"], page.parts["picture"]["check"]["state"]) == (16, "none")
        assert page.state["viewing"]
        page.close()


# --- on emulated devices that outlive both processes --------------------------------------------------------------


# as shipped: neither amplifier nor stage is named, and the emulated ones are driven all the same
SHIPPED = re.sub(r"  parts:\n(    .*\n)+", "", CONFIG)


@pytest.fixture
def viewing(tmp_path, monkeypatch, request):
    """A console with a live view, its page, and the devices."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    with console_in(
        tmp_path / "console", "--scope", config=getattr(request, "param", CONFIG), rig="--emulate"
    ) as console:
        page = PlainPage(console, Client(console))
        assert page.post("view/begin")[0] == 200
        page.until(lambda: "picture" in page.parts)
        (folder,) = temporary.glob("mesotap-devices-*")
        devices = Devices(folder)
        yield console, page, devices
        with contextlib.suppress(RigError):
            devices.call("end")
        devices.close()
        page.close()


def loaded(page, devices):
    """Turn the micrometer until there is a load, and wait until the page shows it."""
    devices.call("push", 12.0 + PUSHED_UM)
    page.until(lambda: (page.parts["load"]["mn"] or 0) > 200)


def apart(devices, longest_s=30.0):
    """Wait until the devices say that there is no load; they may end right after that."""
    end = time.monotonic() + longest_s
    while devices.call("state")["load_mn"] > 0.0:
        assert time.monotonic() < end, "the load is still on"
        time.sleep(0.002)


@pytest.mark.slow
def test_a_load_over_the_limit_is_an_alarm_and_taken_off(viewing):
    _, page, devices = viewing
    loaded(page, devices)
    devices.call("push", 12.0 + OVER_UM)
    page.until(lambda: page.state["ended"] is not None and not page.state["viewing"])
    assert "over the limit of 1100 mN" in page.state["ended"]["text"]
    assert page.state["ended"]["text"].endswith("the surfaces are apart")
    assert page.state["alarm"] == ""
    assert page.post("view/begin")[0] == 200  # it can begin again
    page.until(lambda: page.state["words"] == "live view")


@pytest.mark.slow
def test_the_console_killed(viewing):
    console, page, devices = viewing
    loaded(page, devices)
    console.kill()
    apart(devices)


@pytest.mark.slow
def test_the_console_hung(viewing):
    """STOP does not pass through it, so what runs ends by itself."""
    console, page, devices = viewing
    loaded(page, devices)
    console.process.send_signal(signal.SIGSTOP)
    try:
        apart(devices)
    finally:
        console.process.send_signal(signal.SIGCONT)


@pytest.mark.slow
def test_the_acquisition_killed(viewing):
    console, page, devices = viewing
    assert page.post("view/check", {"side": "middle"})[0] == 200  # with the drivers, before there is a load
    page.until(lambda: page.parts["picture"]["check"]["state"] == "done")
    assert [v["says"] for v in page.parts["picture"]["check"]["verdicts"] if not v["passed"]] == []
    loaded(page, devices)
    (child,) = [pid for pid in children_of(console.process.pid) if b"session_process" in command_of(pid)]
    os.kill(child, signal.SIGKILL)
    apart(devices)  # the guardian
    page.until(lambda: page.state["ended"] is not None)
    page.until(lambda: "the guardian took over" in page.state["ended"]["text"])
    assert page.state["ended"]["text"].endswith("the surfaces are apart")


@pytest.mark.slow
@pytest.mark.parametrize("viewing", [SHIPPED], indirect=True)
def test_the_acquisition_killed_where_the_configuration_names_no_devices(viewing):
    assert "parts" not in SHIPPED
    console, page, devices = viewing
    loaded(page, devices)
    (child,) = [pid for pid in children_of(console.process.pid) if b"session_process" in command_of(pid)]
    os.kill(child, signal.SIGKILL)
    apart(devices)
    page.until(
        lambda: page.state["ended"] is not None and "took over: the surfaces are apart" in page.state["ended"]["text"]
    )


def children_of(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def command_of(pid: int) -> bytes:
    return Path(f"/proc/{pid}/cmdline").read_bytes()
