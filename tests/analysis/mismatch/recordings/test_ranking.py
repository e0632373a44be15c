"""Which of candidates that explain nearly alike counts."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.ranking import TELLS, lead_of, share_that_tells, simplest
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


def missing(errors: np.ndarray, free: bool = False) -> SimulatedFit:
    problem = SimpleNamespace(recordings=(SimpleNamespace(free=free),), samples=errors.size)
    return cast(SimulatedFit, SimpleNamespace(problem=problem, off=lambda number: (errors[None], slice(None))))


def test_long_recordings_are_looked_at_in_part_and_short_ones_and_decays_as_a_whole() -> None:
    even = np.random.default_rng(1).normal(size=20_000)
    assert share_that_tells(missing(even)) == TELLS / 20_000
    assert share_that_tells(missing(even, free=True)) == 1.0
    assert share_that_tells(missing(even[:TELLS])) == 1.0


def test_a_sweep_is_looked_at_until_it_has_come_to_what_the_rig_misses() -> None:
    errors = np.full(20_000, 1e-3)
    errors[13_000:14_000] = 1.0
    assert 0.65 < share_that_tells(missing(errors)) < 0.75
