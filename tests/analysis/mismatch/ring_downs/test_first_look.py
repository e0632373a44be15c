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


def looked_at(*laws: str, noise: float = 5e-4, ratios: tuple[float, ...] = (0.3, 0.6, 0.9)) -> FirstLook:
    problem = problem_of(session_of(with_law(*laws), noise=noise, ratios=ratios))
    current = fit(problem)
    scores = by_mechanism(State(current, screen(problem, current, variants(catalogue()))), every_law=True)
    return first_look(current, scores)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["rough_surface_stiffness", "hertz_stiffness"])
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


def test_where_the_linear_rig_explains_the_beginnings_nothing_is_known_of_any_law() -> None:
    assert looked_at(noise=5e-4) == FirstLook()


@pytest.mark.slow
def test_the_strongest_taps_of_each_load_are_looked_at() -> None:
    look = looked_at("contact_loss", noise=5e-3, ratios=(0.6, 1.3, 0.9, 1.4))
    assert look.linear is not None
    assert [s.name for s in look.linear.segments] == [f"{i:05d}" for i in (1, 3, 5, 7, 9, 11)]
    assert look.explaining() == [("contact_loss", CONTACT)]
    assert look.worth_fitting()[0] == ("contact_loss", CONTACT)
