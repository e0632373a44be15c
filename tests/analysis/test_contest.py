"""The contest's way from one mechanism to the next, beside its fits."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.mismatch import contest
from analysis.mismatch.coordinates import MOST_RATIO, believable
from analysis.mismatch.problem import Term
from analysis.mismatch.screen import Score
from sim_backend.mechanisms.mechanism import mechanisms


def entry(name: str, evidence: float) -> Any:
    term = SimpleNamespace(mechanism=SimpleNamespace(id=name))
    return SimpleNamespace(id=name, fit=object(), evidence=evidence, score=SimpleNamespace(term=term))


@pytest.mark.parametrize(("second", "explains", "taken"), [(80.0, "b", "b"), (60.0, "b", "a"), (80.0, "", "a")])
def test_where_the_best_first_mechanism_leads_nowhere_one_nearly_as_good_is_tried(
    monkeypatch: pytest.MonkeyPatch, second: float, explains: str, taken: str
) -> None:
    begun: Any = SimpleNamespace(p_value=1e-6, baseline=None, screening=None)
    monkeypatch.setattr(contest, "_full_fits", lambda *_: (entry("a", 100.0), entry("b", second)))

    def path(begun: object, entries: Any, *_: object) -> Any:
        return SimpleNamespace(first=entries[0].id, chosen=entries[0].fit if entries[0].id == explains else None)

    monkeypatch.setattr(contest, "_path", path)
    found: Any = contest.run_contest(begun, [])
    assert found.first == taken


def test_sliders_one_and_many_are_both_begun_where_both_are_near() -> None:
    slip = mechanisms()["micro_slip"]

    def score(sliders: int, reach: float, gain: float) -> Score:
        values = {"slip_stiffness_share": 1e-3, "slip_reach_share": reach, "sliders": sliders}
        return Score(Term(slip, values), gain, 1, 1.0, 0.0)

    scores = [score(8, 0.1, 1000.0), score(8, 0.2, 990.0), score(1, 0.1, 900.0), score(1, 0.2, 890.0)]
    assert contest._variants(scores) == [scores[0], scores[2]]
    assert contest._variants([scores[0], score(1, 0.1, 500.0)]) == [scores[0]]


@pytest.mark.parametrize("name", ["attached_mass", "frame_compliance", "rocking"])
def test_a_body_that_hardly_rings_is_not_believable(name: str) -> None:
    mechanism = mechanisms()[name]
    mass, stiffness, damping = mechanism.body  # type: ignore[misc]
    values = {mass: 4.0, stiffness: 9.0, damping: 2 * MOST_RATIO * 6.0}
    assert not believable(Term(mechanism, {}), values)
    assert believable(Term(mechanism, {}), values | {damping: 0.9 * values[damping]})
    assert believable(Term(mechanisms()["micro_slip"], {}), {})


@pytest.mark.parametrize(("exponent", "out"), [(1 / 3, False), (0.42, False), (0.6, True), (1.0, True)])
def test_a_force_law_that_the_growth_of_the_stiffness_contradicts_is_out(exponent: float, out: bool) -> None:
    loads = np.array([0.1, 0.2, 0.4, 0.8])
    fitted: Any = SimpleNamespace(
        problem=SimpleNamespace(recordings=SimpleNamespace(loads_n=loads)),
        constants=SimpleNamespace(names=lambda: ([], ["kc", "cc"]), load=np.c_[2e6 * loads**exponent, np.ones(4)]),
    )
    against = -contest.stiffness_evidence(mechanisms()["hertz_stiffness"], fitted)
    assert (against > contest.CONTRADICTED) == out
    assert against == pytest.approx(((exponent - 1 / 3) / 0.03) ** 2, abs=1e-6)
    assert contest.stiffness_evidence(mechanisms()["micro_slip"], fitted) == 0.0
