"""A single law that nobody listed, learned before three listed mechanisms are looked for together."""

from __future__ import annotations

import math

import pytest

from analysis.mismatch.diagnosis import diagnose
from analysis.mismatch.learning import is_learned
from tests.analysis.ring_downs import problem_of, session_of
from tests.analysis.terms import listed
from tests.analysis.unlisted import at_upper_mass


def root_of_rate(d: float, v: float, load: float) -> float:
    return 1.2e-4 * math.copysign(math.sqrt(abs(v) / 1e-3), v)


@pytest.mark.slow
def test_a_law_that_leaves_nothing_ends_the_search_for_listed_ones() -> None:
    few = [listed(name) for name in ("hunt_crossley_damping", "hertz_stiffness", "quadratic_damping")]
    said: list[str] = []
    problem = problem_of(session_of(at_upper_mass(root_of_rate), ratios=(0.3, 0.6, 0.9)))
    found = diagnose(problem, few, said.append)
    assert found.answer.verdict == "new_physics"
    assert [m.learned for m in found.answer.mechanisms] == [True]
    assert found.selection.chosen is not None
    assert all(map(is_learned, found.selection.chosen.terms))
    learned = said.index("learning a law that nobody listed")
    assert not any(text.endswith(" first") for text in said)
    assert not any(f"fitting {name.id.replace('_', ' ')}" in said[learned:] for name in few)
