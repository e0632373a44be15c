"""Two listed laws in one element, or a single one that nobody listed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from analysis.mismatch.learning import LearnedEarly, with_one_law
from analysis.mismatch.parameters import Term
from tests.analysis.terms import listed


def naming(*laws: tuple[str, int]) -> Any:
    return SimpleNamespace(chosen=SimpleNamespace(terms=tuple(Term(listed(name), {}, (e,)) for name, e in laws)))


@pytest.mark.parametrize("learned", [None, "one law"])
def test_one_law_is_learned_where_several_are_named_in_one_element_alone(
    learned: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LearnedEarly, "__call__", lambda self, selection, to_beat: learned)
    in_one = naming(("quadratic_damping", 1), ("guide_friction", 1))
    assert with_one_law(in_one) == (learned or in_one)
    for apart in (naming(("quadratic_damping", 1), ("guide_friction", 2)), naming(("quadratic_damping", 1))):
        assert with_one_law(apart) is apart
    # a channel's and an added body's numbers are no elements
    beside = naming(("quadratic_damping", 1), ("channel_gain", 1), ("attached_mass", 1))
    assert with_one_law(beside) is beside
    nothing = SimpleNamespace(chosen=None)
    assert with_one_law(nothing) is nothing  # type: ignore[arg-type, comparison-overlap]
