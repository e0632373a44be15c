"""Which of candidates that explain nearly alike counts."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import cast

import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.ranking import lead_of, simplest
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate
from sim_backend.learned.families import learned_mechanisms
from sim_backend.learned.forms import FORM
from sim_backend.mechanisms.kinds import Mechanism
from tests.analysis.terms import listed

SHARE = 0.005
LEARNED = sorted(learned_mechanisms(), key=lambda m: len(m.parameters))
FEW, MANY = LEARNED[0], LEARNED[-1]


def candidate(mechanism: Mechanism, evidence: float, learned: bool = True) -> Candidate[SimulatedFit]:
    term = Term(mechanism, {FORM: 0.0} if learned else {}, ())
    fitted = cast(SimulatedFit, SimpleNamespace(terms=(term,)))
    return Candidate(Score(term, 1.0, 1, math.nan, 0.5), fitted, evidence)


@pytest.mark.parametrize(("behind", "simple"), [(0.0, True), (20.0, True), (49.0, True), (51.0, False), (400.0, False)])
def test_a_law_with_more_parameters_has_to_lead_by_a_share(behind: float, simple: bool) -> None:
    many, few = candidate(MANY, 1e4), candidate(FEW, 1e4 - behind)
    assert simplest([many, few], SHARE) is (few if simple else many)
    assert (lead_of(many, few, SHARE) <= 0) == simple


def test_a_law_with_fewer_parameters_that_explains_more_is_the_best() -> None:
    few, many = candidate(FEW, 1e4), candidate(MANY, 1e4 - 1)
    assert simplest([few, many], SHARE) is few
    assert lead_of(few, many, SHARE) == 1


def test_what_is_listed_is_compared_as_it_is() -> None:
    best = candidate(listed("micro_slip"), 1e4, learned=False)
    other = candidate(listed("guide_friction"), 1e4 - 1, learned=False)
    assert simplest([best, other], SHARE) is best
    assert lead_of(best, other, SHARE) == 1
    assert simplest([best, candidate(FEW, 1e4 - 1)], SHARE) is best
