"""Fits that are made once."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fitted_once import FittedOnce
from sim_backend.mechanisms.catalogue import catalogue

LAW = catalogue()["quadratic_damping"][-1]


def term(strength: float) -> Term:
    return Term(LAW, {LAW.parameters[0].name: strength}, (0,))


def test_a_fit_is_made_once_for_what_it_begins_with() -> None:
    made: list[float] = []

    def fitted(objective: float) -> Any:
        made.append(objective)
        return SimpleNamespace(objective=objective)

    once, begun = FittedOnce(), SimpleNamespace()
    first = once.once(begun, (term(1.0),), 10.0, lambda: fitted(3.0))  # type: ignore[arg-type]
    assert once.once(begun, (term(1.0),), 99.0, lambda: fitted(4.0)) is first  # type: ignore[arg-type]
    once.once(begun, (term(2.0),), 10.0, lambda: fitted(5.0))  # type: ignore[arg-type]
    once.once(SimpleNamespace(), (term(1.0),), 10.0, lambda: fitted(6.0))  # type: ignore[arg-type]
    assert made == [3.0, 5.0, 6.0]


def test_a_fit_that_was_given_up_does_for_none_that_goes_further() -> None:
    once, begun = FittedOnce(), SimpleNamespace()
    given_up = once.once(begun, (term(1.0),), 10.0, lambda: SimpleNamespace(objective=50.0))  # type: ignore
    assert once.once(begun, (term(1.0),), 5.0, lambda: SimpleNamespace(objective=1.0)) is given_up  # type: ignore
    further = once.once(begun, (term(1.0),), 60.0, lambda: SimpleNamespace(objective=2.0))  # type: ignore
    assert further is not given_up
