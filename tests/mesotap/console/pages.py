"""What a person does with the pages."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from tests.mesotap.console.consoles import PATIENCE_MS, ConsoleProcess

NOTE_PRESSES = """() => {
  window.pressed = null;
  for (const kind of ["pointerdown", "keydown"])
    addEventListener(kind, () => { window.pressed = Date.now() / 1000; }, { capture: true });
}"""


def opened(chromium: Any, console: ConsoleProcess, link: str = "", **context: Any) -> Any:
    """Open the console in a browser of its own; what goes wrong in the page is in ``page.faults``."""
    from playwright.sync_api import expect

    expect.set_options(timeout=PATIENCE_MS)  # not 5 s: a machine that is busy draws late
    page = chromium.new_context(**context).new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.faults = []
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.on("dialog", lambda dialog: page.faults.append(dialog.message))
    page.goto(link or console.link)
    return page


def begin(page: Any, **fields: str) -> None:
    """Start a session."""
    page.wait_for_selector("#run:enabled")
    for name, value in fields.items():
        page.fill(f"input[name={name}]", value)
    page.click("#run")


def reach(page: Any, words: str) -> None:
    """Wait until the page shows this state."""
    shows(page, "#words", words)


def shows(page: Any, selector: str, words: str) -> None:
    """Wait until an element shows words, a regular expression."""
    from playwright.sync_api import expect

    expect(page.locator(selector).first).to_contain_text(re.compile(words))


def clicked_at(page: Any, click: Callable[[], Any]) -> float:
    """Click or press, and return when the page saw it, s since 1970."""
    page.evaluate(NOTE_PRESSES)
    click()
    return float(page.evaluate("() => window.pressed"))


def pause_after_a_tap(page: Any) -> None:
    """Start a session, pause it after its first tap, and look at the taps."""
    begin(page)
    page.click("nav a[href='#taps']")
    page.wait_for_selector("#row [data-key='0']")
    page.click("nav a[href='#session']")
    page.click("#pause")
    reach(page, "paused")
    page.click("nav a[href='#taps']")
