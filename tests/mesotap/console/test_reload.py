"""A page reloaded in mid-session shows everything again and changes nothing; control is handed over by who holds it."""

from __future__ import annotations

import pytest

from tests.mesotap.console.consoles import console_in, journal_of, needs_chromium
from tests.mesotap.console.pages import opened, pause_after_a_tap, reach, shows

pytestmark = [needs_chromium, pytest.mark.slow]

SHOWN = ("#row", "#verdict", "#load", "#target", "#limit", "#words", "#next", "#tap-f2", "#tap-kc")


def shown(page):
    """Text of what a page shows under Taps and beside it."""
    return {selector: page.inner_text(selector) for selector in SHOWN}


def test_reload_and_hand_over(chromium, tmp_path):
    with console_in(tmp_path, "--speed", "10", "--set", "mesotap.impacts_per_load=30") as console:
        page = opened(chromium, console)
        pause_after_a_tap(page)
        shows(page, "#next", "Paused, the load is watched")
        shows(page, "#tap-kc", r"\d ±")
        page.wait_for_timeout(500)  # what each load came to follows its last tap
        before, journal = shown(page), journal_of(console)
        load = before.pop("#load")

        page.reload()
        reach(page, "paused")
        shows(page, "#tap-kc", r"\d ±")
        after = shown(page)
        assert float(after.pop("#load")) == pytest.approx(float(load), abs=5)  # it is read on while paused
        assert after == before
        assert any("✓" in part for part in before.values())
        assert page.evaluate("async () => (await import('/static/wire.js')).page.record.samples") == 2000
        page.click("nav a[href='#calibration']")
        shows(page, "#calibration-words", r"Before: .*\d readings")
        page.click("nav a[href='#session']")
        shows(page, "#who", r"This page \(1\) holds control; 0 watching")
        assert page.is_enabled("#pause")
        assert journal_of(console) == journal

        page.click("#another")
        shows(page, "#link", r"/open\?token=\S+ \(opens once\)")
        second = opened(chromium, console, page.inner_text("#link").partition(" ")[0])
        shows(second, "#who", r"This page \(2\) watches; page 1 holds control")
        assert second.is_disabled("#pause")
        second.click("#control")
        page.click("text=Hand control to page 2")
        shows(second, "#who", r"This page \(2\) holds control; 1 watching")
        shows(page, "#who", r"This page \(1\) watches; page 2 holds control")
        page.wait_for_selector("#pause:disabled")
        assert journal_of(console) == journal
        second.click("#pause")
        shows(second, "#words", "^(?!paused$)")
        page.click("#stop")
        reach(second, "ended")
        shows(second, "#alert", "the surfaces are apart")
        assert page.faults == second.faults == []
