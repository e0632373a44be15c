"""What is accepted, named and left out, judged by chi-squared and by impacts that took no part in fitting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import ComputeBudget
from analysis.mismatch.ring_downs import judge as judging
from analysis.mismatch.ring_downs.candidates import without_idle_ones
from analysis.mismatch.ring_downs.fit import CONVERGED, SUBSTEPS, RingDownFit, Stop, fit
from analysis.mismatch.ring_downs.held_out import split
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate, Selection, State, select
from daq.records import Session
from sim_backend.adopted import ANY_RIG
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.ring_downs.selections import (
    Scripted,
    accepted,
    linear,
    scored,
    screening,
    scripted,
    small,
    with_objective,
)
from tests.analysis.ring_downs import LOADS_N, diagnosed, problem_of, session_of, two_mass, with_law
from tests.analysis.terms import at_work, listed


def flawed(session: Session, gain: float = 0.0, delay: float = 0.0) -> Session:
    """Return a session whose channel B has a wrong gain and is late by a part of a sample (linearly interpolated)."""

    def changed(y: np.ndarray) -> np.ndarray:
        late = y[1].copy()
        late[1:] += delay * (y[1, :-1] - y[1, 1:])
        return np.stack([y[0], (1 + gain) * late])

    return replace(session, impacts=tuple(replace(s, acceleration=changed(s.acceleration)) for s in session.impacts))


@dataclass(frozen=True, slots=True)
class Explaining(Scripted):
    """A judge for whom one first mechanism explains all, and every other one nothing."""

    explains: str = ""

    def accepts(
        self, state: State[RingDownFit], candidates: Sequence[Candidate[RingDownFit]]
    ) -> tuple[Candidate[RingDownFit], Mapping[int, float]]:
        return candidates[0], {}

    def after(self, state: State[RingDownFit], accepted: Candidate[RingDownFit]) -> tuple[State[RingDownFit], bool]:
        return state, False

    def outcome(self, baseline: State[RingDownFit], state: State[RingDownFit]) -> Selection[RingDownFit]:
        found = self._ended(baseline, state)
        first = state.steps[0].accepted
        assert first is not None
        return replace(found, chosen=first.fit if first.id == self.explains else None)


@pytest.mark.parametrize(
    ("second", "explains", "exhausted", "taken"),
    [
        (80.0, "channel_skew", False, "channel_skew"),
        (60.0, "channel_skew", False, "channel_gain"),
        (80.0, "", False, "channel_gain"),
        (80.0, "channel_skew", True, "channel_gain"),
    ],
)
def test_where_the_best_first_mechanism_leads_nowhere_one_nearly_as_good_is_tried(
    second: float, explains: str, exhausted: bool, taken: str
) -> None:
    problem = replace(small(), budget=ComputeBudget(1e12 if exhausted else 0.0))
    first_two = tuple(
        Candidate(scored(name, gain), linear(), gain)
        for name, gain in (("channel_gain", 100.0), ("channel_skew", second))
    )
    judge = Explaining(problem, problem, (), (), seen=screening(), ranked=first_two, explains=explains)
    found = select(judge, State(linear(), screening(p_value=1e-6)))
    first = found.steps[0].accepted
    assert first is not None
    assert first.id == taken


def test_a_session_is_worth_a_budget_in_proportion_to_its_samples_and_a_small_one_no_less_than_a_usual_one() -> None:
    policy, samples = small().policy, small().samples

    def exhausted(usual_samples: int, spent: float) -> bool:
        chosen = replace(policy, usual_samples=usual_samples)
        return replace(small(), policy=chosen, budget=ComputeBudget(spent)).exhausted()

    large, usual = 100 * samples, policy.budget * 100 * samples
    assert exhausted(large, 1.01 * usual)
    assert not exhausted(large, 0.99 * usual)
    assert not exhausted(samples // 3, 0.99 * policy.budget * samples)
    assert exhausted(samples // 3, 1.01 * policy.budget * samples)


def test_every_fourth_impact_is_held_out_but_never_all_of_a_load_nor_the_strongest() -> None:
    problem = problem_of(session_of(with_law(), ratios=(0.35, 0.5, 0.65, 0.6)))
    training, held = split(problem)
    assert sorted((*training, *held)) == list(range(12))
    assert held == (3, 7, 11)
    segments = problem.experiment.segments
    assert {segments[i].group for i in training} == {0, 1, 2}
    assert max(range(12), key=lambda i: float(np.abs(segments[i].raw).max())) in training


def test_of_three_impacts_a_load_one_is_held_out() -> None:
    problem = problem_of(session_of(with_law(), ratios=(0.3, 0.4, 0.5))).only(range(6))
    assert split(problem) == ((0, 1, 2, 4, 5), (3,))


@pytest.mark.parametrize(
    ("gain", "fitted"),
    [(0.0, ["base_strain", "channel_gain", "channel_skew"]), (0.05, ["channel_gain", "channel_skew"])],
)
def test_where_the_best_screened_gains_little_the_next_that_promises_more_is_fitted_too(
    gain: float, fitted: list[str]
) -> None:
    problem = problem_of(flawed(session_of(with_law(), noise=0.02), gain=gain)).only((0, 3, 5, 10))
    baseline = fit(problem)
    gains = {"channel_gain": 5e3, "channel_skew": 1e3, "base_strain": 900.0}  # the second one always is
    scores = tuple(scored(name, value, strength=1e-4) for name, value in gains.items())
    scores = tuple(replace(s, term=at_work(s.term.mechanism.id, {s.term.mechanism.strength: 1.0})) for s in scores)
    judge = ImpactJudge(problem, problem, (), ())
    found = judge.candidates(State(baseline, replace(screening(), scores=scores)))
    assert sorted(c.id for c in found if c.fit is not None) == fitted


@pytest.mark.parametrize(("explained", "fitted"), [(False, 10), (True, 5)])
def test_every_mechanism_is_fitted_once_before_any_is_in_a_second_place(
    explained: bool, fitted: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = small().policy
    names = [n for n in catalogue() if listed(n).places(ANY_RIG)][: kept.most_finalists + 2]
    added = at_work("attached_mass").mechanism
    elsewhere = replace(scored("attached_mass", 1e6 - 1), term=Term(added, {}, added.places(ANY_RIG)[1]))
    names = ["attached_mass", *(n for n in names if n != "attached_mass")]
    scores = (*(scored(n, 1e6 - 2 * i) for i, n in enumerate(names)), elsewhere)
    asked: list[tuple[str, object]] = []

    def noted(current: RingDownFit, score: Score, *more: object) -> Candidate[RingDownFit]:
        asked.append((score.term.mechanism.id, score.term.place))
        left = with_objective(2.0 if explained else 1e9)
        return Candidate(score, left, 1.0)

    monkeypatch.setattr(judging, "fitted_candidate", noted)
    monkeypatch.setattr(judging, "started", lambda score: score.term)
    monkeypatch.setattr(judging, "explains", lambda current, candidate: explained)
    monkeypatch.setattr(judging, "continued_candidate", lambda current, candidate: candidate)
    monkeypatch.setattr(judging, "elsewhere", lambda current, scores: [])
    judge = ImpactJudge(small(), small(), (), ())
    judge.candidates(State(linear(), replace(screening(), scores=scores)))
    first = asked[: len({name for name, _ in asked})]
    assert [name for name, _ in first] == names[:fitted]
    assert asked[len(first)][0] == "attached_mass"
    assert asked[len(first)][1] != asked[0][1]


def test_constants_of_every_impact_are_sought_within_a_budget_of_their_own() -> None:
    spent = replace(small(), budget=ComputeBudget(1e30))
    assert spent.exhausted()
    assert not spent.per_impact_constants().exhausted()


@pytest.mark.parametrize(("free", "explained"), [(800.0, True), (815.0, False)])
def test_nothing_is_named_where_something_without_a_name_is_clearly_better(free: float, explained: bool) -> None:
    before, best = with_objective(1800.0), with_objective(1000.0, "channel_gain")
    seen = screening(p_value=0.5)
    baseline = State(before, screening(alone=free))
    state = State(best, seen, (accepted("channel_gain", before, best, 793.0),))
    found = scripted(seen).outcome(baseline, state)
    assert found.left.unnamed == pytest.approx(free - np.log(free) - 793.0)
    assert (found.chosen is best) == explained


@pytest.mark.slow
def test_mechanisms_that_only_stood_in_for_later_ones_are_left_out() -> None:
    problem = problem_of(flawed(session_of(with_law(), noise=0.02), 0.02, 0.1)).only((0, 3, 5, 10))
    names = ("tube_spring_damping", "channel_gain", "channel_skew")
    start = ({"c_n_s_per_m": 0.01}, {"gain_error_of_b": 0.01}, {"delay_of_b_samples": 0.05})
    fits = [fit(problem)]
    for count in (1, 2, 3):
        terms = [at_work(n, v) for n, v in zip(names[:count], start[:count], strict=True)]
        fits.append(fit(problem, terms, fits[0]))
    steps = [
        accepted(name, before, after, before.objective - after.objective)
        for name, before, after in zip(names, fits, fits[1:], strict=False)
    ]
    lean, kept = without_idle_ones(fits[-1], tuple(steps))
    assert [t.mechanism.id for t in lean.terms] == ["channel_gain", "channel_skew"]
    assert [s.accepted.id for s in kept if s.accepted is not None] == ["channel_gain", "channel_skew"]
    assert lean.objective == pytest.approx(fits[-1].objective, abs=small().policy.least_gain)


@pytest.mark.parametrize(("left", "further"), [(250.0, 0), (150.0, 1)])
def test_no_further_mechanism_is_looked_for_where_too_much_is_left(left: float, further: int) -> None:
    fitted = fit(small(), [at_work("channel_gain", {"gain_error_of_b": 1e-4})], linear())
    before = replace(linear(), chi_squared=fitted.objective + 100.0, penalty=0.0)
    seen = screening(unexplained=left)
    candidate = Candidate(scored("channel_gain", 95.0), fitted, 95.0)
    judge = scripted(seen)
    state = State(before, seen, (accepted("channel_gain", before, fitted, 95.0, seen),))
    moved, more = judge.after(state, candidate)
    assert more == bool(further)
    assert judge.outcome(State(before, seen), moved).chosen is None


@pytest.mark.parametrize(("gain", "better"), [(9.0, True), (-1.0, False), (0.0, False)])
def test_held_out_impacts_must_be_predicted_better(gain: float, better: bool) -> None:
    before, after = with_objective(100.0), with_objective(100.0 - gain, "channel_gain")
    added = Candidate(scored("channel_gain", 50.0), after, 50.0)
    assert scripted(held_out=(3,))._better_held_out(before, added) == better


@pytest.mark.parametrize(
    ("missed", "left", "p_value", "named"),
    [(1e4, 500.0, 1e-6, True), (1e4, 2000.0, 1e-6, False), (1e4, 2000.0, 0.5, True), (10.0, 2.9, 1e-6, True)],
)
def test_what_is_lost_on_held_out_impacts_is_not_named(missed: float, left: float, p_value: float, named: bool) -> None:
    numbers = sum(r.size for r in linear().residuals)
    before, best = with_objective(missed * numbers), with_objective(left * numbers, "channel_gain")
    seen = screening(unexplained=10.0, p_value=p_value)
    state = State(best, seen, (accepted("channel_gain", before, best, before.objective - best.objective),))
    judge = scripted(seen, held_out=(3,))
    found = judge.outcome(State(before, screening()), state)
    assert found.chosen is best
    assert judge.lost_on_held_out(found) != named


@pytest.mark.slow
def test_what_is_named_is_fitted_to_its_end() -> None:
    problem = problem_of(session_of(with_law("hertz_stiffness"), noise=0.02)).only((0, 3, 5, 10))
    with np.errstate(all="ignore"):  # of a trial step
        baseline = fit(problem)
        begun = fit(problem, [at_work("hertz_stiffness")], baseline, stop=Stop(6, competing=True))
        gained = baseline.objective - begun.objective
        before, after = screening(20 * abs(gained)), screening(p_value=0.9)
        judge = Scripted(problem, problem, (), (), seen=after)
        step = accepted("hertz_stiffness", baseline, begun, gained - 5, before)
        assert step.accepted is not None
        state, more = judge.after(State(baseline, before, (step,)), step.accepted)
    assert gained > 0
    assert not more
    assert (begun.substeps, state.current.substeps) == (SUBSTEPS // 2, SUBSTEPS)
    assert state.current.objective < begun.objective + CONVERGED  # computed in other substeps


@pytest.mark.parametrize(("left", "least"), [(10.0, 16.0), (100.0, 80.0), (280.0, 224.0), (2000.0, 300.0)])
def test_what_takes_up_most_of_what_is_left_is_worth_fitting_to_the_end(left: float, least: float) -> None:
    before, current = with_objective(11_000.0), with_objective(1000.0, "channel_gain")
    state = State(current, screening(left), (accepted("channel_gain", before, current, 1e4),))
    assert scripted()._least_gain(state) == pytest.approx(least)


@pytest.mark.parametrize(("p_value", "named"), [(1e-4, False), (0.5, True)])
def test_a_small_further_mechanism_counts_if_nothing_is_left_beside_it(p_value: float, named: bool) -> None:
    fitted = fit(small(), [at_work("channel_gain", {"gain_error_of_b": 1e-4})], linear())
    plain, first = (replace(linear(), chi_squared=fitted.objective + more, penalty=0.0) for more in (1e5, 100.0))
    left = screening(unexplained=110.0, p_value=1e-6)
    steps = (accepted("channel_skew", plain, first, 9e4), accepted("channel_gain", first, fitted, 95.0, left))
    assert steps[1].accepted is not None
    judge = scripted(screening(unexplained=10.0, p_value=p_value))
    moved, more = judge.after(State(first, left, steps), steps[1].accepted)
    assert (moved.current is not first) == named
    assert (moved.steps[-1].accepted is not None) == named
    assert not more


@pytest.mark.long
@pytest.mark.parametrize(
    ("law", "noise", "ratios"),
    [("contact_loss", 5e-3, (0.6, 0.9, 1.6, 1.7)), ("hertz_stiffness", 5e-4, (0.5, 0.7, 0.95))],
)
def test_beneath_a_strong_law_the_model_leaves_no_error_of_its_own(
    law: str, noise: float, ratios: tuple[float, ...]
) -> None:
    found = diagnosed([session_of(with_law(law), noise=noise, ratios=ratios)], variants(catalogue())).selection
    assert found.chosen is not None
    assert [t.mechanism.id for t in found.chosen.terms] == [law]
    assert found.left.p_value > 0.01
    true = [two_mass(load).kc for load in LOADS_N]
    # masses are declared, and loads measured, to within what makes 6e-4 of k_c
    assert found.chosen.constants.load[:, 0] == pytest.approx(true, rel=5e-4)


@dataclass(frozen=True, slots=True)
class Adding(Scripted):
    """A judge who accepts one mechanism after the other, and for whom so many together explain all."""

    explain: int = 9

    def accepts(
        self, state: State[RingDownFit], candidates: Sequence[Candidate[RingDownFit]]
    ) -> tuple[Candidate[RingDownFit], Mapping[int, float]]:
        return candidates[0], {}

    def after(self, state: State[RingDownFit], accepted: Candidate[RingDownFit]) -> tuple[State[RingDownFit], bool]:
        names = ("channel_gain", "channel_skew", "rocking")[: len(state.steps)]
        return State(with_objective(10.0, *names), state.screening, state.steps), len(names) < self.explain

    def outcome(self, baseline: State[RingDownFit], state: State[RingDownFit]) -> Selection[RingDownFit]:
        all_of_it = len(state.current.terms) >= self.explain
        return replace(self._ended(baseline, state), chosen=state.current if all_of_it else None)


@pytest.mark.parametrize(
    ("explain", "learned", "asked", "named"),
    [(1, True, 0, 1), (2, True, 0, 2), (3, True, 1, 0), (3, False, 1, 3), (9, True, 1, 0), (9, False, 1, None)],
)
def test_what_is_not_listed_is_asked_for_once_and_before_three_mechanisms_together(
    explain: int, learned: bool, asked: int, named: int | None
) -> None:
    one = (Candidate(scored("channel_gain", 100.0), linear(), 100.0),)
    judge = Adding(small(), small(), (), (), seen=screening(), ranked=one, explain=explain)
    told: list[int] = []

    def instead(found: Selection[RingDownFit]) -> Selection[RingDownFit] | None:
        told.append(len(found.best.terms))
        return replace(found, chosen=linear()) if learned else None

    found = select(judge, State(linear(), screening(p_value=1e-6)), instead=instead)
    assert told == [2] * asked
    assert named == (None if found.chosen is None else len(found.chosen.terms))
