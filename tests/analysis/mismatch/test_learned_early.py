"""A single law that nobody listed, learned before three listed mechanisms are looked for together."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from analysis.mismatch.learning import LearnedEarly, _behind, _learner, families_beside, is_learned, with_learned
from analysis.mismatch.policy import POLICY
from analysis.mismatch.problem import silent
from analysis.mismatch.ring_downs.selecting import select_for_impacts
from analysis.mismatch.selection import Selection
from sim_backend.learned.curves import Curve
from sim_backend.mechanisms.kinds import AddedBody
from tests.analysis.ring_downs import problem_of, session_of
from tests.analysis.terms import listed
from tests.analysis.unlisted import at_upper_mass


def root_of_rate(d: float, v: float, load: float) -> float:
    return 1.2e-4 * math.copysign(math.sqrt(abs(v) / 1e-3), v)


@pytest.mark.long
def test_a_law_that_leaves_nothing_ends_the_search_for_listed_ones() -> None:
    few = [listed(name) for name in ("hunt_crossley_damping", "hertz_stiffness", "quadratic_damping")]
    problem = problem_of(session_of(at_upper_mass(root_of_rate), ratios=(0.3, 0.6, 0.9)))
    early = LearnedEarly()
    asked: list[int] = []

    def instead(found: Selection) -> Selection | None:  # type: ignore[type-arg]
        asked.append(len(found.best.terms))
        return early(found)

    found, aside = select_for_impacts(problem, few, silent, instead)
    assert len(asked) == 1
    assert asked[0] <= problem.policy.few_terms
    assert found.chosen is not None
    assert [is_learned(term) for term in found.chosen.terms] == [True]
    assert not aside
    assert with_learned(found, early) is found


@pytest.mark.parametrize(
    ("noise_known", "law", "behind"), [(False, 40.0, True), (False, 60.0, False), (True, 40.0, False)]
)
def test_a_law_that_explains_less_than_what_is_listed_takes_no_place(
    noise_known: bool, law: float, behind: bool
) -> None:
    """A second impact in one of three decays, at its best, was given up for a resonance that explained less."""
    evidence = {"law": law, "listed": 50.0}
    judge = SimpleNamespace(lead=lambda found, other: evidence[found.name] - evidence[other.name])
    problem = SimpleNamespace(noise_known=noise_known)
    found: Any
    listed_ones: Any
    found, listed_ones = (SimpleNamespace(name=name, judge=judge, problem=problem) for name in ("law", "listed"))
    assert _behind(found, listed_ones) is behind


@pytest.mark.parametrize(
    ("noise_known", "listed_body", "learned"), [(False, True, 0), (False, False, 1), (True, True, 1)]
)
def test_a_body_that_is_listed_is_not_learned_of_recordings_as_it_was_fitted_already(
    noise_known: bool, listed_body: bool, learned: int
) -> None:
    asked: list[Any] = []
    judge = SimpleNamespace(
        known=[listed("attached_mass" if listed_body else "quadratic_damping")],
        on_progress=silent,
        training=SimpleNamespace(budget=SimpleNamespace(spent=1.0)),
        knowing=lambda laws, policy, to_beat: asked.extend(laws),
    )
    problem = SimpleNamespace(noise_known=noise_known, policy=POLICY)
    selection: Any = SimpleNamespace(judge=judge, problem=problem, chosen=None)
    _learner(selection)
    assert sum(isinstance(m, AddedBody) for m in asked) == learned
    assert len(asked) > 10


@pytest.mark.parametrize(
    ("named", "left", "contested"), [(0, 1.0, True), (1, 0.0085, False), (1, 0.05, True), (3, 0.0085, True)]
)
def test_a_curve_contests_several_names_and_one_that_leaves_much(named: int, left: float, contested: bool) -> None:
    """A spring with another law each way was a squared force, a cubed one and a knock, which leave 0.85 percent."""
    selection: Any = SimpleNamespace(
        problem=SimpleNamespace(noise_known=False),
        judge=SimpleNamespace(known=[]),
        chosen=SimpleNamespace(terms=(0,) * named) if named else None,
        left=SimpleNamespace(share=left),
    )
    assert any(isinstance(law, Curve) for law in families_beside(selection)) is contested
