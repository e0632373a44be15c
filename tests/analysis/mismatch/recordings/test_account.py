"""How a rival is told beside the best candidate."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from analysis.mismatch.recordings.account import BlockAccount


def test_an_error_that_is_the_same_is_as_large() -> None:
    said: Any = BlockAccount.compared
    best = SimpleNamespace(losses=(4.0, 4.0), id="micro_slip")
    assert "is as large as that of micro slip alone" in said(None, SimpleNamespace(losses=(4.0, 4.0)), best)
    assert "is 1.5 times that of micro slip alone" in said(None, SimpleNamespace(losses=(9.0, 9.0)), best)
