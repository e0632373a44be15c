"""Whole sessions run from pages in Chromium; skipped where there is none."""

from __future__ import annotations

import json
import re

import pytest

from daq.session_file import read_session
from tests.mesotap.console.consoles import PATIENCE_MS, console_in, journal_of, needs_chromium
from tests.mesotap.console.pages import begin, opened, reach

pytestmark = needs_chromium

RESPONSE_DRAWN = "() => document.querySelectorAll('.responses canvas')[1].toDataURL()"

LONG_DIAGNOSIS = ("--set", "mesotap.diagnose=true", "--set", "mesotap.impacts_per_load=8")
"""Of 16 taps: ten seconds of an idle machine, in which a page is looked at ten times a second."""


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["--simulate", "--emulate"])
def test_a_whole_session_from_the_page(chromium, tmp_path, rig):
    from playwright.sync_api import expect

    # a dwell of 3 s by the clock: a state that is over sooner may pass between two looks at the page
    with console_in(tmp_path, "--speed", "20", "--set", "mesotap.dwell_s=60", rig=rig) as console:
        page = opened(chromium, console)
        begin(page, specimen="<img src=x onerror=alert(1)>")
        reach(page, "locking")
        page.click("nav a[href='#taps']")
        expect(page.locator("#verdict")).to_contain_text("accepted", timeout=PATIENCE_MS)
        reach(page, "done")
        page.click("nav a[href='#loads']")
        own = page.frame_locator("iframe[title='Report of this session']")
        expect(own.locator("body")).to_contain_text("Contact stiffness and damping", timeout=PATIENCE_MS)
        page.click("nav a[href='#sessions']")
        expect(page.locator("#past tbody tr")).to_contain_text("<img src=x onerror=alert(1)>", timeout=PATIENCE_MS)
        page.click("#past button")
        report = page.frame_locator("iframe.report")
        expect(report.locator("body")).to_contain_text("Contact stiffness and damping", timeout=PATIENCE_MS)
        assert page.faults == []
        (file,) = console.sessions.glob("*/session.h5")
        session = read_session(file)
        assert session.complete
        assert len(session.impacts) == 4
        assert session.specimen == "<img src=x onerror=alert(1)>"


@pytest.mark.long
def test_the_page_says_what_is_worked_out_and_stop_leaves_the_diagnosis_out(chromium, tmp_path):
    from playwright.sync_api import expect

    with console_in(tmp_path, "--speed", "40", *LONG_DIAGNOSIS) as console:
        page = opened(chromium, console)
        begin(page)
        reach(page, "working out the diagnosis")
        said = page.evaluate("() => ['filing', 'next'].map((id) => document.getElementById(id).textContent)")
        page.click("#stop")
        reach(page, "done")
        assert said[0].startswith("working out the diagnosis")
        assert said[1].startswith("The report is there")
        assert page.is_hidden("#alert")
        page.click("nav a[href='#loads']")
        report = page.frame_locator("iframe[title='Report of this session']")
        expect(report.locator("body")).to_contain_text("Contact stiffness and damping", timeout=PATIENCE_MS)
        assert journal_of(console)[-1]["event"] == "filed"
        assert not list(console.sessions.glob("*/diagnosis.html"))
        assert page.faults == []


@pytest.mark.slow
def test_stop_by_the_space_bar_and_resume(chromium, tmp_path):
    with console_in(tmp_path, "--speed", "20", "--set", "mesotap.dwell_s=100") as console:
        page = opened(chromium, console)
        begin(page)
        reach(page, "locking")
        page.keyboard.press("Space")
        reach(page, "ended")
        assert "the surfaces are apart" in page.text_content("#alert")
        assert journal_of(console)[-2]["event"] == "safe"
        assert journal_of(console)[-2]["troubles"] == []
        page.click("button.resume")
        reach(page, "done")
        assert journal_of(console)[-1]["event"] == "filed"
        assert page.faults == []


@pytest.mark.slow
def test_two_sessions_are_compared(chromium, tmp_path):
    from playwright.sync_api import expect

    for name, k_c in (("one", 4.6e6), ("two", 4.9e6)):
        folder = tmp_path / "sessions" / name
        folder.mkdir(parents=True)
        header = {"created": "2026-01-01T00:00:00.000Z", "config": f"mesotap: {{specimen: {name}}}"}
        (folder / "session.json").write_text(json.dumps(header))
        (folder / "report.html").write_text("<p>a report</p>")
        value = {"value": k_c, "low": k_c - 1e4, "high": k_c + 1e4}
        zeta = {"value": 0.02, "low": 0.01, "high": 0.03}
        around = {"value": 299.0, "low": 298.0, "high": 300.0}
        load = {"target_load_mn": 300.0, "load_mn": around, "contact_stiffness_n_per_m": value, "zeta2": zeta}
        (folder / "results.json").write_text(json.dumps({"loads": [load]}))
    with console_in(tmp_path) as console:
        page = opened(chromium, console)
        page.click("nav a[href='#sessions']")
        for name in ("one", "two"):
            page.check(f"[aria-label='compare {name}']")
        page.click("#compare")
        row = page.locator("#compared tbody tr")
        expect(row).to_contain_text("4.600 ± 0.010", timeout=PATIENCE_MS)
        expect(row).to_contain_text("4.900 ± 0.010")
        page.fill("#search", "two")
        expect(page.locator("#past tbody tr")).to_have_count(1)
        assert page.faults == []


@pytest.mark.slow
def test_the_space_bar_on_a_checkbox_is_stop_and_leaves_it_as_it_is(chromium, tmp_path):
    folder = tmp_path / "sessions" / "one"
    folder.mkdir(parents=True)
    (folder / "session.json").write_text(json.dumps({"created": "2026-01-01T00:00:00.000Z", "config": ""}))
    (folder / "report.html").write_text("<p>a report</p>")
    with console_in(tmp_path) as console:
        page = opened(chromium, console)
        page.click("nav a[href='#sessions']")
        box = page.locator("[aria-label='compare one']")
        box.focus()
        with page.expect_request("**/api/stop"):
            page.keyboard.press("Space")
        assert not box.is_checked()
        page.keyboard.press("Enter")
        assert box.is_checked()
        assert page.faults == []


@pytest.mark.long
def test_a_surplus_of_taps_and_the_hammer_are_shown_on_the_smallest_screen_too(chromium, tmp_path):
    from playwright.sync_api import expect

    hammer = ("rig.wiring.hammer={input: 3}", "sim_backend.hammer={noise_n: 0.01}")
    changes = ("mesotap.surplus_impacts=2", "mesotap.load_plan_mn=[400]", *hammer)
    options = [part for change in changes for part in ("--set", change)]
    with console_in(tmp_path, "--speed", "20", *options) as console:
        page = opened(chromium, console)
        page.set_viewport_size({"width": 390, "height": 844})
        begin(page)
        page.click("nav a[href='#taps']")
        expect(page.locator("#choice")).to_contain_text("2 kept and 2 left out so far", timeout=PATIENCE_MS)
        page.locator("#row .left").first.click()
        expect(page.locator("#verdict")).to_contain_text("left out by the choice so far", timeout=PATIENCE_MS)
        expect(page.locator("#left-out")).to_contain_text("in coherence with the 2 taps kept")
        expect(page.locator("#hammer")).to_contain_text("excites to", timeout=PATIENCE_MS)
        expect(page.locator("#tap-force")).to_contain_text("N")
        expect(page.locator("#force canvas")).to_have_count(2)
        expect(page.locator(".response-taps")).to_contain_text(re.compile("[2-9] taps"), timeout=PATIENCE_MS)
        drawn = []
        for how, words in (
            ("h1", "H1 takes noise"),
            ("h2", "It is H1 over the coherence"),
            ("hv", "halfway between H1"),
        ):
            page.select_option(".responses select", how)
            expect(page.locator(".responses")).to_contain_text(words)
            drawn.append(page.evaluate(RESPONSE_DRAWN))
        assert len(set(drawn)) == 3
        assert page.evaluate("() => document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        reach(page, "done")
        assert page.faults == []
