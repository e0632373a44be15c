"""How a rival is told beside the best candidate."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

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
