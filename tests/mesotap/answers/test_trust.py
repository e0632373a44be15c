"""Whether the numbers can be trusted, and what to do next: each line in each of its states."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.session import DRIFTED
from mesotap.answers.recording_files import sha256_of
from mesotap.answers.trust import LINE, Light, Trust, trusted, what_next
from mesotap.report.report import refresh_trust
from tests.mesotap.report.test_report import make_session, report

SESSION, RESULTS = make_session(loads=2)
PLAIN = replace(RESULTS, loads=tuple(replace(load, notes=()) for load in RESULTS.loads))
NAMED = {"statement": "Dry friction in the guide.", "probability": 0.98}


def line(what: str, session=SESSION, results=PLAIN, folder=Path("nowhere")) -> Trust:
    (found,) = [line for line in trusted(session, results, folder) if line.what == what]
    assert found.brief
    assert len(f"{what}: {found.light.value}, {found.brief}") <= LINE
    return found


def diagnosed(folder: Path, verdict: str, mechanisms: list[dict[str, object]], **more: object) -> None:
    (folder / "session.h5").write_bytes(b"the recording")
    hashed = sha256_of(folder / "session.h5")
    answer = {"version": 2, "verdict": verdict, "mechanisms": mechanisms, "recordings": [{"sha256": hashed}], **more}
    (folder / "diagnosis.json").write_text(json.dumps(answer))


def test_a_good_session_asks_for_a_diagnosis_only():
    lines = trusted(SESSION, PLAIN, Path("nowhere"))
    assert [each.light for each in lines] == [Light.GOOD] * 4 + [Light.OPEN]
    assert "mesotap diagnose session.h5" in what_next(lines)


def test_no_calibration_one_calibration_and_drift():
    assert line("Calibration", results=replace(PLAIN, calibration=None)).light is Light.BAD
    gauge = PLAIN.calibration
    assert gauge is not None
    once = replace(PLAIN, calibration=replace(gauge, drift_p_value=None))
    assert line("Drift of the gauge", results=once).light is Light.OPEN
    drifted = replace(PLAIN, calibration=replace(gauge, drifted=True))
    assert line("Drift of the gauge", results=drifted).light is Light.DOUBT
    # one cause, one severity: what is noted of it at each load is not counted again
    noted = replace(PLAIN.loads[0], notes=(DRIFTED,))
    assert line("Each load", results=replace(drifted, loads=(noted,))).light is Light.GOOD
    other = replace(noted, notes=(DRIFTED, "a further mode at 900 Hz"))
    assert line("Each load", results=replace(drifted, loads=(other,))).light is Light.DOUBT
    assert "repeat the loads" in what_next(trusted(SESSION, drifted, Path("nowhere")))
    bent = replace(
        PLAIN, calibration=replace(gauge, statement="The calibration before the test is curved (p = 0.001).")
    )
    assert line("Calibration", results=bent).light is Light.DOUBT


def test_few_taps_many_rejected_and_taps_by_hand():
    few = replace(PLAIN, loads=(replace(PLAIN.loads[0], impacts_used=2), PLAIN.loads[1]))
    assert "fewer than 3 good ones at 260 mN" in line("Taps", results=few).words
    none = replace(PLAIN, impacts=(), loads=())
    assert line("Taps", results=none).light is Light.BAD
    rejected = tuple(replace(i, accepted=n % 2 == 0) for n, i in enumerate(PLAIN.impacts))
    assert "more than usual" in line("Taps", results=replace(PLAIN, impacts=rejected)).words
    first = replace(SESSION.impacts[0], extra={"overruled": "a second impact", "hand_reason": "it is small"})
    by_hand = line("Taps", session=replace(SESSION, impacts=(first, *SESSION.impacts[1:])))
    assert (by_hand.light, "1 accepted by hand" in by_hand.words) == (Light.DOUBT, True)


def test_a_load_without_a_contact_mode_and_one_with_notes():
    assert line("Each load", results=RESULTS).light is Light.DOUBT
    lost = replace(PLAIN, loads=(PLAIN.loads[0], replace(PLAIN.loads[1], contact_stiffness_n_per_m=None)))
    assert "No contact mode at 350 mN" in line("Each load", results=lost).words


@pytest.mark.parametrize(
    ("verdict", "mechanisms", "light", "words"),
    [
        ("consistent", [], Light.GOOD, "nothing that it leaves out"),
        ("unexplained", [], Light.DOUBT, "no known mechanism explains"),
        ("missing_physics", [NAMED], Light.DOUBT, "probability 0.98): Dry friction in the guide"),
    ],
)
def test_what_a_diagnosis_beside_the_report_found(tmp_path, verdict, mechanisms, light, words):
    diagnosed(tmp_path, verdict, mechanisms)
    assert line("Eq. 9 as a model", folder=tmp_path).evidence == "diagnosis.json"  # its page is not there
    (tmp_path / "diagnosis.html").write_text("its page")
    found = line("Eq. 9 as a model", folder=tmp_path)
    assert (found.light, found.evidence) == (light, "diagnosis.html")
    assert words in found.words


def test_a_diagnosis_in_the_folder_of_the_page_is_found_wherever_the_session_lies(tmp_path):
    diagnosed(tmp_path, "consistent", [])
    recording = tmp_path / "session.h5"
    hashed = sha256_of(recording)
    recording.unlink()
    (found,) = [one for one in trusted(SESSION, PLAIN, tmp_path, hashed) if one.what == "Eq. 9 as a model"]
    assert found.light is Light.GOOD
    (other,) = [one for one in trusted(SESSION, PLAIN, tmp_path, "0" * 64) if one.what == "Eq. 9 as a model"]
    assert other.light is Light.OPEN


def test_a_page_of_its_own_folder_says_what_the_diagnosis_there_found_and_links_each_light(tmp_path):
    open_page = report(tmp_path, SESSION, RESULTS)
    diagnosed(tmp_path, "consistent", [])
    hashed = sha256_of(tmp_path / "session.h5")
    (tmp_path / "session.h5").unlink()
    page = report(tmp_path, SESSION, RESULTS, origin={"sha256": hashed})
    assert "A diagnosis found nothing that it leaves out." in page
    for one in (open_page, page):
        lights = re.search('<ul class="trust">(.*?)</ul>', one, re.DOTALL)
        assert lights is not None
        links = re.findall('<a href="([^"]+)">', lights[1])
        assert len(links) == lights[1].count("<li ")
        for link in links:
            assert f'id="{link[1:]}"' in one if link.startswith("#") else (tmp_path / link).is_file()


@pytest.mark.parametrize(
    "damage",
    [
        lambda folder: (folder / "session.h5").write_bytes(b"another recording"),
        lambda folder: (folder / "session.h5").unlink(),
        lambda folder: (folder / "diagnosis.json").write_text("{"),
        lambda folder: (folder / "diagnosis.json").write_text("[]"),
        lambda folder: diagnosed(folder, "missing_physics", [{}]),
        lambda folder: diagnosed(folder, "consistent", [], version=1),
        lambda folder: diagnosed(folder, "consistent", [], recordings="none"),
    ],
)
def test_a_diagnosis_of_another_recording_or_a_damaged_one_counts_as_none(tmp_path, damage):
    diagnosed(tmp_path, "consistent", [])
    damage(tmp_path)
    assert line("Eq. 9 as a model", folder=tmp_path).light is Light.OPEN


def test_a_diagnosis_that_was_made_after_the_report_is_said_in_it(tmp_path):
    before = report(tmp_path, SESSION, RESULTS)
    assert "Not tested: no diagnosis was run." in before
    diagnosed(tmp_path, "missing_physics", [{**NAMED, "statement": r"A \\1 <b>bold</b> claim"}])
    refresh_trust(tmp_path, SESSION, RESULTS)
    after = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Not tested" not in after
    assert "&lt;b&gt;bold&lt;/b&gt; claim" in after
    for name in ("trust", "reasons"):
        parts = [
            html.partition(f"<!-- {name} -->")[2].partition(f"<!-- end of {name} -->")[0] for html in (before, after)
        ]
        assert parts[0] != parts[1]
        before, after = (html.replace(part, "") for html, part in zip((before, after), parts, strict=True))
    assert after == before
