"""What the page of a diagnosis calls things."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from analysis.mismatch.answer import RecordingFile, Rival, UpperLimit, Verdict
from mesotap.answers.diagnosis_page import Evidence, write_page
from mesotap.answers.diagnosis_text import print_answer
from tests.mesotap.answers.made import ANSWER

NOTHING = Evidence((), (), (), (), (), (), "")


def test_files_are_named_without_their_folders(tmp_path: Path) -> None:
    answer = replace(ANSWER, recordings=tuple(RecordingFile(f"/deep/folder/{n}.h5", "0" * 64) for n in "ab"))
    text = write_page(tmp_path, answer, NOTHING, {}, pdf_figures=False).read_text()
    assert "a.h5 + b.h5" in text
    assert "/deep" not in text


def test_what_is_unusual_in_the_files_stands_at_the_head(tmp_path: Path) -> None:
    said = "s.h5: /impacts/00001/acceleration holds a NaN; this record is left out"
    text = write_page(tmp_path, ANSWER, NOTHING, {"remarks": [said]}, pdf_figures=False).read_text()
    assert text.index(said) < text.index("Verdict</h2>")


def test_parameters_are_told_by_what_they_are_with_one_notation_of_units_on_page_and_terminal(tmp_path: Path) -> None:
    limits = (
        UpperLimit("adhesion", "adhesion_range_share", 0.01, "1", 0.95),
        UpperLimit("base_strain", "base_strain_m_s2_per_n", 8.2e-5, "m/N s2", 0.95),
        UpperLimit("of_my_own", "its_share", 0.02, "1", 0.95),
    )
    answer = replace(ANSWER, upper_limits=limits)
    known = replace(NOTHING, meanings={("adhesion", "adhesion_range_share"): "its range over P / k_c"})
    text = write_page(tmp_path, answer, known, {}, pdf_figures=False).read_text()
    said = "its range over <i>P</i> / <i>k</i><sub>c</sub>"
    assert f'<td class="text">{said} <small class="id">adhesion_range_share</small></td>' in text
    assert '<td class="text">its_share</td>' in text
    shown = Console(file=io.StringIO(), width=200)
    print_answer(answer, shown)
    printed = shown.file.getvalue()  # type: ignore[attr-defined]
    assert "m/(N s²)" in text
    assert "m/(N s²)" in printed
    assert "m/N s2" not in printed


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        ("consistent", "that this is missing all the same"),
        ("unexplained", "that this is at work and nothing else"),
        ("missing_physics", "that this is at work instead of what is named"),
    ],
)
def test_the_table_of_rivals_says_what_their_probability_is_of(tmp_path: Path, verdict: Verdict, says: str) -> None:
    named = ANSWER.mechanisms if verdict == "missing_physics" else ()
    answer = replace(
        ANSWER, verdict=verdict, mechanisms=named, rivals=(Rival(("drift",), 0.072, None, "It is small."),)
    )
    text = write_page(tmp_path, answer, NOTHING, {}, pdf_figures=False).read_text()
    (caption,) = (c for c in re.findall("<caption>(.*?)</caption>", text) if "held-out rms" in c)
    assert f"Probability: {says}" in caption
