"""Settings in the page: a wrong value, the sentence for it, the difference, and what is saved."""

from __future__ import annotations

import pytest

from tests.mesotap.console.consoles import console_in, needs_chromium
from tests.mesotap.console.pages import opened, shows

TEXT = "mesotap:\n  dwell_s: 1.0  # rest\n"


@needs_chromium
@pytest.mark.slow
def test_a_wrong_value_is_told_and_a_right_one_saved(chromium, tmp_path):
    with console_in(tmp_path, config=TEXT) as console:
        page = opened(chromium, console)
        page.click("nav a[href='#settings']")
        page.fill("[name='mesotap.dwell_s']", "-3")
        page.press("[name='mesotap.dwell_s']", "Tab")
        shows(page, "#outcome", r"config\.yaml, line 2: mesotap\.dwell_s is -3")
        assert page.is_disabled("#save")
        wrong = page.locator("label:has([name='mesotap.dwell_s'][aria-invalid])")
        assert "mesotap.dwell_s is -3" in wrong.locator(".fault").text_content()  # where one looks
        page.fill("[name='mesotap.dwell_s']", "30")
        page.press("[name='mesotap.dwell_s']", "Tab")
        shows(page, "#outcome pre", r"\+  dwell_s: 30  # rest")
        assert page.locator(".fault, [aria-invalid]").count() == 0
        page.fill("[name='mesotap.specimen']", "Müller: plate #7")
        page.press("[name='mesotap.specimen']", "Tab")
        shows(page, "#outcome pre", "Müller")
        page.click("#save:enabled")
        shows(page, "#outcome", "saved")
        if page.faults:
            raise AssertionError(page.faults)
        page.screenshot(path=str(tmp_path / "settings.png"))
    assert console.config.read_text() == "mesotap:\n  specimen: 'Müller: plate #7'\n  dwell_s: 30  # rest\n"
