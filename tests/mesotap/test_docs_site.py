"""What the check of the documentation's site finds."""

from __future__ import annotations

from pathlib import Path

from rig.plugins import module_of
from tests.mesotap.installed import ROOT

check = module_of(ROOT / "docs" / "_site" / "check.py", "docs")
generated = module_of(ROOT / "docs" / "_site" / "generated.py", "docs")

PAGE = """<html><head><link href="a.css"></head><body><h1 id="here">A</h1><a href="b.html#there">b</a>
<a href="#here">up</a><a href="https://example.org">elsewhere</a><img src="data:image/png;base64,AA=="></body></html>"""


def site(folder: Path, page: str) -> list[str]:
    (folder / "a.css").write_text("")
    (folder / "a.html").write_text(page)
    (folder / "b.html").write_text('<p id="there"></p>')
    return list(check.faults_of_site(folder))


def test_a_sound_site_has_no_faults(tmp_path: Path) -> None:
    assert site(tmp_path, PAGE) == []


def test_what_leads_nowhere_is_found(tmp_path: Path) -> None:
    assert site(tmp_path, PAGE.replace("b.html#there", "b.html#nowhere")) == [
        "a.html: b.html#nowhere has no such place"
    ]
    assert site(tmp_path, PAGE.replace("b.html#there", "c.html")) == ["a.html: c.html is not there"]
    assert site(tmp_path, PAGE.replace("a.css", "b.css")) == ["a.html: b.css is not there"]
    assert site(tmp_path, PAGE.replace("#here", "#away")) == ["a.html: #away has no such place"]


def test_what_is_fetched_from_elsewhere_is_found(tmp_path: Path) -> None:
    assert site(tmp_path, PAGE.replace("a.css", "https://cdn.org/a.css")) == ["a.html: fetches https://cdn.org/a.css"]


def test_the_pages_beside_the_docs_lead_somewhere() -> None:
    assert list(check.faults_of_repository()) == []


def test_every_command_and_decision_is_listed() -> None:
    text = "\n".join(generated.commands())
    for command in ("run", "config migrate", "drivers", "udev", "certificate check"):
        assert f"## mesotap {command}\n" in text
    assert "`--method ml\\|era`" in text
    listed = generated.decisions(ROOT / "docs" / "decisions")
    assert len(listed) == len(list((ROOT / "docs" / "decisions").glob("[0-9]*.md")))
