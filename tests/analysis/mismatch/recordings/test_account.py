"""How a rival is told beside the best candidate."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

from analysis.mismatch.law_reading import _formula
from analysis.mismatch.recordings.account import BlockAccount


def tried(loss: float, terms: int = 1) -> Any:
    return SimpleNamespace(losses=(loss, loss), id="micro_slip", fit=SimpleNamespace(terms=(None,) * terms))


def test_an_error_that_is_the_same_is_as_large() -> None:
    said: Any = BlockAccount.compared
    best = tried(4.0)
    assert "is as large as that of micro slip alone" in said(None, tried(4.0), best)
    assert "is 1.5 times that of micro slip alone" in said(None, tried(9.0), best)


def test_what_was_weighed_beside_others_is_not_told_as_alone() -> None:
    said: Any = BlockAccount.compared
    best = tried(4.0, terms=2)
    assert said(None, tried(9.0, terms=2), best).endswith("that of micro slip, both beside what else is named.")
    assert said(None, tried(9.0), best).endswith("1.5 times that of micro slip and what else is named.")


def test_a_formula_has_the_rig_s_own_units() -> None:
    """A coupling of a rig that turns had a force in N of a deflection in m."""
    turns: Any = SimpleNamespace(described=SimpleNamespace(length_unit="rad", force_unit="N m"))
    text = "-2.969 N * abs(d / 0.09705 m)**1.633 + 1.2 N * sign(v) * abs(v / 0.4 m/s)**2"
    read: Any = SimpleNamespace(
        term=SimpleNamespace(values={}), form=SimpleNamespace(text=lambda values: text, key="power"), parameters={}
    )
    account: Any = SimpleNamespace(unit=partial(BlockAccount.unit, turns))
    told = "-2.969 N m * abs(d / 0.09705 rad)**1.633 + 1.2 N m * sign(v) * abs(v / 0.4 rad/s)**2"
    assert _formula(account, read, 1.0).text == told
