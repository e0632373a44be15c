"""What explains the first milliseconds after the taps."""

from __future__ import annotations

import pytest

from analysis.mismatch.ring_downs.first_look import TAPS, FirstLook, first_look
from analysis.mismatch.ring_downs.fit import fit
from analysis.mismatch.ring_downs.order import by_mechanism
from analysis.mismatch.score_test import screen
from analysis.mismatch.selection import State
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.ring_downs import LOADS_N, problem_of, session_of, with_law

CONTACT = (2,)  # place of the contact's element in the tester


def looked_at(*laws: str, noise: float = 5e-4) -> FirstLook:
    problem = problem_of(session_of(with_law(*laws), noise=noise, ratios=(0.3, 0.6, 0.9)))
    current = fit(problem)
    scores = by_mechanism(State(current, screen(problem, current, variants(catalogue()))), every_law=True)
    return first_look(current, scores)


@pytest.mark.parametrize("law", ["rough_surface_stiffness", pytest.param("hertz_stiffness", marks=pytest.mark.slow)])
def test_a_strong_law_is_the_only_one_that_explains_a_few_milliseconds(law: str) -> None:
    look = looked_at(law)
    assert look.explaining() == [(law, CONTACT)]
    assert look.left((law, CONTACT)) < 1e-4
    assert min(look.left(key) for key in look.laws if key[0] != law) > 0.05
    assert look.linear is not None
    assert len(look.linear.segments) == TAPS * len(LOADS_N)
    assert {r.shape[1] for r in look.linear.residuals} == {150}


def test_without_a_look_nothing_is_known_of_any_law() -> None:
    assert FirstLook().explaining() == []
    assert FirstLook().left(("hertz_stiffness", CONTACT)) == 1.0
