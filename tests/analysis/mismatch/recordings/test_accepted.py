"""Which mechanism is accepted where two are at work and what one leaves is the other's."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.mismatch.policy import POLICY
from analysis.mismatch.recordings import judge as judging
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.score_test import FreeForm, Score, Screening
from analysis.mismatch.selection import Candidate, State

EVIDENCE, LEFT = 850.0, 230.0  # as of case 3 of seed 660131: a part that rides, and a contact that bends


def screening(*gains: float) -> Screening:
    term: Any = None
    scores = tuple(Score(term, gain, 1, 1.0, 0.0) for gain in gains)
    return Screening(scores, 1e-50, (), np.zeros((0, 0)), FreeForm(LEFT, 1, 1e-50, {}, LEFT), LEFT)


def test_what_no_single_mechanism_explains() -> None:
    assert screening(200.0, 20.0).beyond_one == 30.0
    assert screening().beyond_one == LEFT


@pytest.mark.parametrize(("gain", "accepted"), [(LEFT + 7, True), (LEFT / 10, False)])
def test_what_another_mechanism_explains_beside_it_speaks_against_none(
    gain: float, accepted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The choosing blocks show nothing of the first; a fifth of its evidence and more is left, by one or by nobody."""
    assert POLICY.left_over_blocks * EVIDENCE < LEFT
    monkeypatch.setattr(judging, "chooses_no_worse", lambda before, after: True)
    monkeypatch.setattr(judging, "ratio_in", lambda *_: -2.6)
    monkeypatch.setattr(BlockJudge, "screen", lambda *_: screening(gain))
    before, fitted = (SimpleNamespace(by_block=lambda part: (35.5, 1.6), as_noise=True, terms=()) for _ in range(2))
    fitted.simulation = SimpleNamespace(struck=None)
    judge: Any = BlockJudge(SimpleNamespace(policy=POLICY, one_decay=False, draws=lambda fitted: 0), ())  # type: ignore[arg-type]
    score: Any = SimpleNamespace(term=None)
    candidate: Any = Candidate(score, fitted, EVIDENCE, losses=(36.0, 1.6))  # type: ignore[type-var]
    state: Any = State(before, screening(EVIDENCE))  # type: ignore[type-var]
    assert judge._better(state, candidate) == accepted
