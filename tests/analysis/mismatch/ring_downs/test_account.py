"""How likely what is named is, beside what nobody listed."""

from __future__ import annotations

import pytest

from analysis.mismatch.policy import POLICY
from analysis.mismatch.ring_downs.account import ImpactAccount
from analysis.mismatch.selection import LeftOver, Selection
from tests.analysis.mismatch.ring_downs.selections import accepted, screening, scripted, with_objective


def odds(gain: float, unnamed: float = -50.0, left: float = 0.0, name: str = "channel_gain") -> float:
    before, best = with_objective(1000.0 + gain), with_objective(1000.0, name)
    step = accepted(name, before, best, gain)
    over = LeftOver(left, 0.0, left / (gain + left), unnamed)
    found = Selection(scripted(), before, screening(), (step,), best, best, screening(left), over)
    return ImpactAccount(found)._odds_of_something_else(step)


def test_the_weaker_an_effect_the_likelier_something_that_is_not_listed() -> None:
    assert odds(100.0) > odds(900.0) > odds(1e4) > 0
    assert 1 / (1 + odds(900.0)) < 0.9 < 1 / (1 + odds(1e4))


def test_something_without_a_name_that_leads_by_enough_is_likelier_than_what_is_named() -> None:
    assert odds(1e4, unnamed=POLICY.unnamed) > 1


def test_the_more_is_left_the_likelier_something_that_is_not_listed() -> None:
    assert odds(1e4, left=10.0) > odds(1e4)
    allowed = POLICY.may_be_left(1)
    assert odds(1e4, left=1e4 * allowed / (1 - allowed)) == pytest.approx(1.0)


def test_something_that_is_not_listed_looks_like_an_added_body_however_strong_that_is() -> None:
    assert odds(1e6, name="rocking") == pytest.approx(POLICY.unlisted)
    assert odds(1e6) == pytest.approx(POLICY.strong_likeness, rel=0.01)
    assert odds(100.0, name="rocking") == odds(100.0) > POLICY.unlisted  # what is weak looks like anything already
