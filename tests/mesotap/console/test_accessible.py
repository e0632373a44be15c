"""axe-core finds nothing serious on any page, dark or light; where it lies is told by ``MESOTAP_AXE``."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.mesotap.console.consoles import PATIENCE_MS, console_in, needs_chromium
from tests.mesotap.console.pages import begin, opened, reach, shows

AXE = Path(os.environ.get("MESOTAP_AXE", "")) / "node_modules/axe-core/axe.min.js"
SERIOUS = ("serious", "critical")
FOUND = """async () => (await axe.run(document, { iframes: false })).violations.map((v) =>
  ({ id: v.id, impact: v.impact, where: v.nodes.map((n) => `${n.target} ${n.failureSummary}`) }))"""

pytestmark = [
    needs_chromium,
    pytest.mark.slow,
    pytest.mark.skipif(not AXE.is_file(), reason="MESOTAP_AXE names no folder with axe-core: make console-axe"),
]


def findings(page, theme):
    """What axe finds on each page of the console, serious or critical."""
    found = {}
    for link in page.locator("nav a").all():
        link.click()
        name = link.get_attribute("href")
        page.wait_for_selector("main > *", state="attached")
        page.wait_for_timeout(300)  # what the page asks for has come
        for finding in page.evaluate(FOUND):
            if finding["impact"] in SERIOUS:
                found[f"{theme} {name} {finding['id']}"] = finding["where"][:3]
    return found


def test_nothing_serious_on_any_page(chromium, tmp_path):
    with console_in(tmp_path, "--speed", "20", "--set", "mesotap.dwell_s=100") as console:
        page = opened(chromium, console)
        page.add_init_script(path=AXE)
        page.reload()
        page.wait_for_function("() => typeof axe === 'object' && axe.version !== undefined", timeout=PATIENCE_MS)
        found = {}

        def look(when):
            for _ in range(2):
                theme = page.get_attribute("html", "data-theme")
                found.update({f"{when} {name}": where for name, where in findings(page, theme).items()})
                page.click("#theme")
            page.click("nav a[href='#session']")

        page.wait_for_selector("#run:enabled")
        page.evaluate("document.querySelector('footer').append(document.createElement('button'))")
        assert [f["id"] for f in page.evaluate(FOUND) if f["impact"] in SERIOUS] == ["button-name"]  # it does find
        page.evaluate("document.querySelector('footer > button:not([id])').remove()")
        look("idle")
        begin(page, specimen="a pair of plates")
        reach(page, "locking")
        page.click("#pause")
        reach(page, "paused")
        look("running")
        page.click("#pause")
        reach(page, "done")
        look("done")
        assert page.faults == []
        assert found == {}


def test_nothing_serious_in_the_live_view(chromium, tmp_path):
    with console_in(tmp_path, "--scope", "--set", "sim_backend.sensors.b.gain=-1") as console:
        page = opened(chromium, console)
        page.add_init_script(path=AXE)
        page.reload()
        page.wait_for_function("() => typeof axe === 'object' && axe.version !== undefined", timeout=PATIENCE_MS)
        page.click("#begin:enabled")
        page.click("#check-by-tap:enabled")
        shows(page, "#check", "1 of 9 to mend")
        found = {}
        for _ in range(2):
            found.update(findings(page, page.get_attribute("html", "data-theme")))
            page.click("#theme")
        assert page.faults == []
        assert found == {}
