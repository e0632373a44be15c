"""Every threshold says what it means, in which unit, on which data it was chosen, and which decision argues for it."""

from __future__ import annotations

from dataclasses import Field
from pathlib import Path
from typing import Any

import pytest

from analysis.mismatch.policy import POLICY, thresholds

DECISIONS = {int(f.name[:4]) for f in (Path(__file__).parents[3] / "docs" / "decisions").glob("[0-9]*.md")}


@pytest.mark.parametrize("threshold", thresholds(), ids=lambda t: t.name)
def test_a_threshold_says_what_it_is_and_why(threshold: Field[Any]) -> None:
    for key in ("meaning", "unit", "on"):
        assert threshold.metadata[key].strip()
    assert threshold.metadata["record"] in DECISIONS


@pytest.mark.parametrize(("terms", "share"), [(0, 0.02), (1, 0.02), (2, 0.005), (3, 0.0), (7, 0.0)])
def test_the_more_mechanisms_the_less_they_may_leave(terms: int, share: float) -> None:
    assert POLICY.may_be_left(terms) == share
