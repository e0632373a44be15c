"""What goes wrong in a session, as a person sees it: a double impact, a drifted gauge, a load over its limit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from daq.session_file import read_session
from sim_backend.emulators.bench_process import Devices
from tests.mesotap.console.consoles import PATIENCE_MS, console_in, journal_of, needs_chromium
from tests.mesotap.console.pages import begin, opened, pause_after_a_tap, reach, shows
from tests.mesotap.session.separate import CONFIG

pytestmark = [needs_chromium, pytest.mark.slow]

ONE_LOAD = ("--set", "mesotap.load_plan_mn=[300]")
ALL_DOUBLE = (
    *("--set", "sim_backend.bad_taps.double=1.0"),
    *("--set", "mesotap.tries_per_load=1000", "--set", "mesotap.impacts_per_load=4"),
)
"""But for those after which the simulated person was told to pull back faster."""

REASON = "the second impact is small"
DRIFTING = ("--set", "sim_backend.gauge.sensitivity_drift_percent_per_hour=60", "--set", "calibration.repeats=2")
LEANT_UM = 8.0
"""On tube springs of 0.27 N/um in series: 2 N more."""


def test_a_double_impact_is_told_and_may_be_accepted_by_hand(chromium, tmp_path):
    from playwright.sync_api import expect

    with console_in(tmp_path, "--speed", "6", *ONE_LOAD, *ALL_DOUBLE) as console:
        page = opened(chromium, console)
        pause_after_a_tap(page)
        page.click("#row [data-key='0']")
        shows(page, "#verdict", "Tap 0: ✗ not used.*second impact")
        page.fill("[name=reason]", REASON)
        page.click("#judge")
        shows(page, "#noted", "it counts when the session goes on")
        page.click("nav a[href='#session']")
        page.click("#pause")
        page.click("nav a[href='#taps']")
        shows(page, "#verdict", f"Tap 0: ✓ accepted by hand.*{REASON}")
        reach(page, "done")
        page.click("nav a[href='#loads']")
        report = page.frame_locator("iframe[title='Report of this session']").locator("body")
        expect(report).to_contain_text(REASON, timeout=PATIENCE_MS)
        assert page.faults == []
        (file,) = console.sessions.glob("*/session.h5")
        first = read_session(file).impacts[0]
        assert first.accepted
        assert first.extra["hand_reason"] == REASON
        assert "second impact" in first.extra["overruled"]


def test_a_drifted_gauge_is_told_with_what_it_means(chromium, tmp_path):
    from playwright.sync_api import expect

    with console_in(tmp_path, "--speed", "40", *ONE_LOAD, *DRIFTING) as console:
        page = opened(chromium, console)
        begin(page)
        reach(page, "done")
        shows(page, "#alert", "gauge drifted between its calibrations: the loads of this session are in doubt")
        page.click("nav a[href='#calibration']")
        shows(page, "#drift", "The strain gauge drifted.*differ.*What it means: every load")
        assert page.get_attribute("#drift", "role") == "alert"
        shows(page, "#calibration-words", r"After: .* mV/mN \(\+?\d")
        page.reload()  # it is told anew to a page that comes later
        shows(page, "#drift", "The strain gauge drifted")
        page.click("nav a[href='#loads']")
        report = page.frame_locator("iframe[title='Report of this session']").locator("body")
        expect(report).to_contain_text("The strain gauge drifted", timeout=PATIENCE_MS)
        assert page.faults == []


def test_a_load_over_the_limit_is_an_alarm(chromium, tmp_path):
    with console_in(tmp_path, "--set", "mesotap.dwell_s=600", config=CONFIG, rig="--emulate") as console:
        page = opened(chromium, console)
        begin(page)
        reach(page, "locking")
        (folder,) = [p for p in console.sessions.iterdir() if p.is_dir()]
        devices = Devices(Path(json.loads((folder / "session.json").read_text())["devices"]))
        devices.call("push", LEANT_UM)
        reach(page, "ended")
        devices.call("push", 0.0)
        shows(page, "#alert", r"mN.*the surfaces are apart")
        shows(page, "#next", "Look at the rig, mend what the alarm says")
        assert page.get_attribute("#alert", "role") == "alert"
        assert devices.call("state")["load_mn"] == 0.0
        assert [e["troubles"] for e in journal_of(console) if e["event"] == "safe"] == [[]]
        page.wait_for_selector("button.resume:enabled")
        devices.call("end")
        devices.close()
        assert page.faults == []
