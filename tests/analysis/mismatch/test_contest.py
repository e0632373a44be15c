"""The contest's way from one mechanism to the next, beside its fits."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.mismatch import contest, diagnosis
from analysis.mismatch.coordinates import MOST_RATIO, believable
from analysis.mismatch.problem import Effort, Term
from analysis.mismatch.screen import Score
from sim_backend.mechanisms.mechanism import mechanisms


def entry(name: str, evidence: float) -> Any:
    term = SimpleNamespace(mechanism=SimpleNamespace(id=name))
    return SimpleNamespace(id=name, fit=object(), evidence=evidence, score=SimpleNamespace(term=term))


@pytest.mark.parametrize(
    ("second", "explains", "worn_out", "taken"),
    [(80.0, "b", False, "b"), (60.0, "b", False, "a"), (80.0, "", False, "a"), (80.0, "b", True, "a")],
)
def test_where_the_best_first_mechanism_leads_nowhere_one_nearly_as_good_is_tried(
    monkeypatch: pytest.MonkeyPatch, second: float, explains: str, worn_out: bool, taken: str
) -> None:
    begun: Any = SimpleNamespace(p_value=1e-6, baseline=None, screening=None, worn_out=lambda contests: worn_out)
    monkeypatch.setattr(contest, "_full_fits", lambda *_: (entry("a", 100.0), entry("b", second)))

    def path(begun: object, entries: Any, *_: object) -> Any:
        return SimpleNamespace(first=entries[0].id, chosen=entries[0].fit if entries[0].id == explains else None)

    monkeypatch.setattr(contest, "_path", path)
    found: Any = contest.run_contest(begun, [])
    assert found.first == taken


def test_a_session_is_worth_an_effort_in_proportion_to_its_samples_and_a_small_one_no_less_than_a_usual_one() -> None:
    def worn_out(samples: int, spent: float, contests: int) -> bool:
        problem: Any = SimpleNamespace(samples=samples, effort=Effort(spent))
        nothing: Any = None
        return contest.Begun(problem, (), (), nothing, nothing).worn_out(contests)

    usual = contest.MOST_EFFORT * contest.USUAL_SAMPLES
    assert worn_out(1000, 1.01 * usual, 1)
    assert not worn_out(1000, 0.99 * usual, 1)
    assert not worn_out(1000, 1.99 * usual, 2)
    assert not worn_out(3 * contest.USUAL_SAMPLES, 2.99 * usual, 1)
    assert worn_out(3 * contest.USUAL_SAMPLES, 3.01 * usual, 1)


@pytest.mark.parametrize(("gained", "fitted"), [(-5.0, ["double_hit", "channel_skew"]), (2000.0, ["double_hit"])])
def test_where_the_best_screened_gains_little_the_next_that_promises_more_is_fitted_too(
    monkeypatch: pytest.MonkeyPatch, gained: float, fitted: list[str]
) -> None:
    scores = [Score(Term(mechanisms()[n], {}), g, 1, 1.0, 0.0) for n, g in (("double_hit", 5e3), ("channel_skew", 1e3))]
    asked: list[str] = []

    def fit_of(current: object, score: Score, *_: object) -> contest.Entry:
        asked.append(score.term.mechanism.id)
        chi_squared = SimpleNamespace(chi_squared=1.0, residuals=(np.zeros(1),))
        return contest.Entry(score, chi_squared, gained)  # type: ignore[arg-type]

    monkeypatch.setattr(contest, "_variants", lambda _: [])
    monkeypatch.setattr(contest, "_entry", fit_of)
    monkeypatch.setattr(contest, "stiffness_evidence", lambda *_: 0.0)
    current: Any = SimpleNamespace(terms=(), objective=1e4, penalty=0.0)
    screening: Any = SimpleNamespace(scores=scores)
    contest._full_fits(current, screening, [], lambda _: None, lambda: False)
    assert asked == fitted


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


def taken(name: str, before: float, after: float, gained: float) -> Any:
    """Return a round that accepted a mechanism of one parameter."""
    term = SimpleNamespace(mechanism=SimpleNamespace(id=name, parameters=(None,)))
    accepted = SimpleNamespace(
        id=name, fit=SimpleNamespace(objective=after), evidence=gained, own=0, score=SimpleNamespace(term=term)
    )
    return contest.Round(SimpleNamespace(objective=before), None, (), accepted)  # type: ignore[arg-type]


@pytest.mark.parametrize(("free", "explained"), [(800.0, True), (815.0, False)])
def test_nothing_is_named_where_something_without_a_name_is_clearly_better(free: float, explained: bool) -> None:
    screening: Any = SimpleNamespace(
        unexplained=0.0, p_value=0.5, free=SimpleNamespace(best_alone=free), scores=(), bins=None
    )
    begun: Any = SimpleNamespace(
        problem=None,
        training=(),
        held_out=(),
        baseline=SimpleNamespace(objective=1800.0),
        screening=screening,
        p_value=0.0,
    )
    best: Any = SimpleNamespace(objective=1000.0, terms=("one",))
    found = contest._outcome(begun, best, screening, (taken("a", 1800.0, 1000.0, 793.0),))
    assert found.unnamed == pytest.approx(free - np.log(free) - 793.0)
    assert (found.chosen is best) == explained


def test_mechanisms_that_only_stood_in_for_later_ones_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    left = {("a", "b", "c"): 1000.0, ("a", "c"): 1500.0, ("b", "c"): 1004.0, ("c",): 1600.0}

    def fitted(terms: tuple[str, ...]) -> Any:
        return SimpleNamespace(problem=None, terms=terms, objective=left[terms])

    monkeypatch.setattr(contest, "_competing", lambda problem, terms, *_: fitted(terms))
    monkeypatch.setattr(contest, "_to_the_end", lambda found: found)
    rounds = [taken("a", 9e3, 4e3, 5e3), taken("b", 4e3, 2e3, 2e3), taken("c", 2e3, 1e3, 1e3)]
    lean, kept = contest._without_idle_ones(fitted(("a", "b", "c")), rounds)
    assert lean.terms == ("b", "c")
    assert [r.accepted.id for r in kept if r.accepted is not None] == ["b", "c"]


def test_the_weaker_an_effect_the_likelier_something_that_is_not_listed() -> None:
    fit: Any = SimpleNamespace(objective=1000.0, terms=("one",))

    def odds(gain: float, unnamed: float = -50.0, left: float = 0.0) -> float:
        outcome: Any = SimpleNamespace(
            unnamed=unnamed, left_over=left, left_p_value=0.0, baseline=SimpleNamespace(objective=1000.0 + gain)
        )
        return diagnosis._odds_of_something_else(fit, taken("a", 1000.0 + gain, 1000.0, gain), outcome)

    assert odds(100.0) > odds(900.0) > odds(1e4) > 0
    assert 1 / (1 + odds(900.0)) < 0.9 < 1 / (1 + odds(1e4))
    assert odds(1e4, unnamed=contest.UNNAMED) > 1
    assert odds(1e4, left=10.0) > odds(1e4)
    allowed = contest.may_be_left(1)
    assert odds(1e4, left=1e4 * allowed / (1 - allowed)) == pytest.approx(1.0)


@pytest.mark.parametrize(("left", "further"), [(250.0, 0), (150.0, 1)])
def test_no_further_mechanism_is_looked_for_where_too_much_is_left(
    monkeypatch: pytest.MonkeyPatch, left: float, further: int
) -> None:
    accepted = taken("a", 1000.0, 900.0, 95.0).accepted
    accepted.fit = SimpleNamespace(objective=900.0, terms=("one",))
    screening: Any = SimpleNamespace(
        unexplained=left, p_value=0.0, scores=(), free=SimpleNamespace(best_alone=0.0), bins=None
    )
    looked: list[int] = []

    def none_more(*_: Any) -> tuple[()]:
        looked.append(1)
        return ()

    monkeypatch.setattr(contest, "screen", lambda *_: screening)
    monkeypatch.setattr(contest, "_to_the_end", lambda found: found)
    monkeypatch.setattr(contest, "_full_fits", none_more)
    baseline: Any = SimpleNamespace(objective=1000.0, terms=())
    begun: Any = SimpleNamespace(
        problem=None, training=(), held_out=(), baseline=baseline, screening=screening, p_value=0.0
    )
    found = contest._path(begun, (accepted,), [], lambda _: None, lambda: False)
    assert len(looked) == further
    assert found.chosen is None


@pytest.mark.parametrize(
    ("gain", "found", "better"),
    [(9.0, 50.0, True), (3.0, 50.0, False), (3.0, 500.0, True), (-1.0, 500.0, False), (-1.0, 50.0, False)],
)
def test_held_out_impacts_must_gain_or_not_lose_by_what_is_beyond_doubt(
    monkeypatch: pytest.MonkeyPatch, gain: float, found: float, better: bool
) -> None:
    before: Any = SimpleNamespace(
        chi_squared=100.0, problem=SimpleNamespace(recordings=SimpleNamespace(records=(1, 2)))
    )
    added: Any = SimpleNamespace(fit=SimpleNamespace(chi_squared=100.0 - gain), own=0, evidence=found)
    monkeypatch.setattr(contest, "held_out_fit", lambda problem, held, fitted: fitted)
    assert contest._better_held_out(None, (3,), before, added) == better  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("begun", "wanted", "taken_over"),
    [
        (("contact_loss",), ("contact_loss", "double_hit"), True),
        (("contact_loss",), ("contact_loss", "frame_compliance"), False),
        (("contact_loss",), ("frame_compliance", "contact_loss"), False),
        (("frame_compliance",), ("frame_compliance", "contact_loss"), False),
        ((), ("contact_loss",), False),
    ],
)
def test_a_fit_beside_laws_begins_at_the_amplitudes_they_left(
    monkeypatch: pytest.MonkeyPatch, begun: tuple[str, ...], wanted: tuple[str, ...], taken_over: bool
) -> None:
    def terms(names: tuple[str, ...]) -> tuple[Term, ...]:
        return tuple(Term(mechanisms()[name], {}) for name in names)

    begin: Any = SimpleNamespace(terms=terms(begun), amplitudes=("as they were",))
    monkeypatch.setattr(contest, "fit", lambda problem, terms, begin, held, delays, most, amplitudes, **_: amplitudes)
    found: Any = contest._competing(None, terms(wanted), begin, ())  # type: ignore[arg-type]
    assert found == (begin.amplitudes if taken_over else ())


def test_what_is_named_is_fitted_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    free = SimpleNamespace(best_alone=0.0)
    # before, forces of any shape seemed to explain much more than the mechanism; then nothing is left over
    before, after = (
        SimpleNamespace(unexplained=u, p_value=p, scores=(), free=free, bins=None)
        for u, p in ((900.0, 0.0), (0.0, 0.9))
    )
    accepted = taken("a", 1000.0, 900.0, 95.0).accepted
    accepted.fit = SimpleNamespace(objective=900.0, terms=("one",), end=False)
    monkeypatch.setattr(contest, "screen", lambda *_: after)
    monkeypatch.setattr(
        contest, "_to_the_end", lambda fitted: SimpleNamespace(objective=895.0, terms=("one",), end=True)
    )
    begun: Any = SimpleNamespace(
        problem=None, training=(), held_out=(), baseline=SimpleNamespace(objective=1000.0, terms=()), screening=before,
        p_value=0.0,
    )  # fmt: skip
    found: Any = contest._path(begun, (accepted,), [], lambda _: None, lambda: False)
    assert contest._far_off(begun, accepted.fit)
    assert found.chosen.end


def test_when_a_second_blow_fell_is_looked_for_again_beside_what_came_later(monkeypatch: pytest.MonkeyPatch) -> None:
    blow, law = (Term(mechanisms()[n], {}) for n in ("double_hit", "guide_friction"))
    asked: list[tuple[float, ...]] = []

    def competing(problem: object, terms: Any, begin: object, delays: Any, *_: object) -> Any:
        asked.append(tuple(delays))
        return SimpleNamespace(problem=problem, terms=tuple(terms), objective=100.0 if len(terms) == 2 else 400.0)

    score = Score(blow, 90.0, 1, 1.0, 0.0, (70.0, 80.0))
    monkeypatch.setattr(contest, "_competing", competing)
    monkeypatch.setattr(contest, "screen", lambda *_: SimpleNamespace(scores=(score,)))
    monkeypatch.setattr(contest, "_rings", lambda fitted: True)
    monkeypatch.setattr(contest, "_far_off", lambda begun, fitted: False)
    monkeypatch.setattr(contest, "_to_the_end", lambda fitted: fitted)
    begun: Any = None
    fitted: Any = SimpleNamespace(problem=None, terms=(blow, law), objective=200.0)
    found = contest._looked_for_again(begun, fitted)
    assert found.objective == 100.0
    assert [t.mechanism.id for t in found.terms] == ["double_hit", "guide_friction"]
    assert asked[-1] == (70.0, 80.0)


@pytest.mark.parametrize(("left", "least"), [(100.0, 300.0), (280.0, 224.0), (2000.0, 300.0), (201.0, 300.0)])
def test_what_takes_up_most_of_too_much_that_is_left_is_worth_naming(left: float, least: float) -> None:
    current: Any = SimpleNamespace(terms=(None,))
    screening: Any = SimpleNamespace(unexplained=left)
    assert contest._least_gain(current, screening, 10_000.0) == pytest.approx(least)
