"""Whatever is given to the command line: one sentence and exit code 2, or read rightly; in bounded memory and time.

``make hostile`` runs all cases and writes docs/hostile.md; the tests here run the quick ones, ``make test`` three.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.hostile import corpus
from tests.hostile.case import LARGEST_MEMORY, fault, run

CASES = [case for case in corpus.cases() if case.quick or "MESOTAP_HOSTILE" in os.environ]
FEW = ("an alias bomb", "names that turn the writing", "a pipe to info")


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=() if case.name in FEW else pytest.mark.slow) for case in CASES],
    ids=[f"{case.kind}: {case.name}".encode("unicode_escape").decode() for case in CASES],
)
def test_a_hostile_input_is_refused_in_one_sentence_or_read_rightly(case, tmp_path: Path):
    folder = tmp_path / "here"
    folder.mkdir()
    outcome = run(case.make(folder), folder)
    assert fault(case, outcome) == ""
    assert outcome.memory < LARGEST_MEMORY


def test_there_are_as_many_hostile_inputs_as_the_page_says():
    page = (Path(__file__).parents[2] / "docs" / "hostile.md").read_text(encoding="utf-8")
    assert f"| all | {len(list(corpus.cases()))} |" in page
