"""Fits that begin where they should, and end where they cannot matter."""

from __future__ import annotations

import math

import numpy as np
import pytest

import analysis.mismatch.recordings.beginning as beginning
import analysis.mismatch.recordings.fit as fitting
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings, fit
from analysis.mismatch.recordings.joining import joined_to
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.made_ready import weighed
from analysis.mismatch.recordings.model import SimulationModel
from analysis.mismatch.recordings.racing import EXPLAINED, Competition
from analysis.mismatch.recordings.ranking import Ranking
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.score_test import Score
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import family
from sim_backend.mechanisms.kinds import AddedBody
from tests.analysis.mismatch.recordings.described_rigs import SPRING, motion, recorded, sensor

K, C, REACH = 5700.0, 1.2, 0.01
HARDENING = 0.8 * K / REACH**2
(CUBIC,) = family("tube_spring_cubic") or ()
DRAG = (family("quadratic_damping") or ())[-1]  # that of an element without a load
(PART,) = (m for m in family("attached_mass") or () if isinstance(m, AddedBody))
CUBED = Term(CUBIC, {"cubic_stiffness_n_per_m3": 0.2 * HARDENING}, (0,))
SQUARED = Term(DRAG, {"quadratic_damping_n_s2_per_m2": 0.5}, (0,))


def at_hz(frequency: float, kg: float = 0.002) -> dict[str, float]:
    omega = 2 * math.pi * frequency
    return dict(zip(PART.body or (), (kg, kg * omega**2, 2 * 0.02 * kg * omega), strict=True))


@pytest.fixture(scope="module")
def linear() -> SimulatedFit:
    """A spring that hardens by 80 %, described as linear."""
    decay = motion(lambda u, x, v: -K * x - C * v - HARDENING * x**3, [REACH, 0.0], 1500, 200.0)[0]
    rig = parse_rig(SPRING + sensor("displacement", 0))
    with np.errstate(all="ignore"):
        return linear_fit(weighed(linear_fit(problem_of(rig, [prepare(recorded([decay], 200.0, 1e-4), rig)]))))


def test_a_body_begins_as_its_trial_says_beside_constants_that_another_fit_of_it_left(linear: SimulatedFit) -> None:
    begun = linear.simulation.with_terms([Term(PART, at_hz(3.0), (0,))], linear.values | at_hz(11.0))
    assert dict(begun.read(begun.begin())[1][0].values) == pytest.approx(at_hz(3.0))
    assert begun.constants | linear.values == begun.constants  # the rig's own are those that were given


def fitted_shares(monkeypatch: pytest.MonkeyPatch) -> list[tuple[tuple[str, ...], float, int]]:
    """Return a list that fills with what is fitted: mechanisms, share of the recording, most linearisations."""
    seen: list[tuple[tuple[str, ...], float, int]] = []
    minimise = fitting.minimise

    def told(model: SimulationModel, start, stopping, race):  # type: ignore[no-untyped-def]
        span = model.simulation.recordings[0].fitted
        share = (model.samples[0] or span.stop - span.start) / (span.stop - span.start)
        seen.append((tuple(t.mechanism.id for t in model.simulation.terms), round(share, 2), stopping.most))
        return minimise(model, start, stopping, race)

    for module in (fitting, beginning):
        monkeypatch.setattr(module, "minimise", told)
    return seen


def test_what_explains_nothing_of_the_beginning_is_followed_no_further(
    linear: SimulatedFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = fitted_shares(monkeypatch)
    for term, followed in ((SQUARED, [0.05, 0.15, 1.0]), (CUBED, [0.05, 0.15, 0.4, 1.0])):
        seen.clear()
        found = fit(linear.problem, (term,), linear, staged=True)
        mine = [(share, most) for ids, share, most in seen if ids == (term.mechanism.id,)]
        assert [share for share, _ in mine] == followed
        assert (mine[-1][1] == 0) == (term is SQUARED)
        assert found.residuals[0].size == linear.residuals[0].size  # all of it is told in any case
    assert found.terms[0].values["cubic_stiffness_n_per_m3"] == pytest.approx(HARDENING, rel=0.01)


def test_what_leaves_more_of_a_part_than_is_to_be_beaten_is_given_up(
    linear: SimulatedFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = fit(linear.problem, (CUBED,), linear, staged=True)
    seen = fitted_shares(monkeypatch)
    fit(linear.problem, (SQUARED,), linear, staged=True, to_beat=EXPLAINED * right.objective)
    assert [(share, most == 0) for ids, share, most in seen if ids] == [(0.15, False), (1.0, True)]


@pytest.mark.parametrize(("term", "made"), [(SQUARED, False), (CUBED, True)])
def test_where_noise_has_to_be_left_the_beginning_tells_whether_a_fit_is_made(
    term: Term, made: bool, linear: SimulatedFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = fit(linear.problem, (CUBED,), linear, staged=True)
    seen = fitted_shares(monkeypatch)
    found = fit(linear.problem, (term,), linear, to_beat=EXPLAINED * right.objective)
    assert [(share, most > 0) for ids, share, most in seen if ids] == [(0.15, True), (1.0, made)]
    assert found.residuals[0].size == linear.residuals[0].size
    seen.clear()
    fit(linear.problem, (term,), linear, to_beat=0.5 * linear.objective)  # what it competes with leaves much itself
    assert [(share, most > 0) for ids, share, most in seen if ids] == [(1.0, True)]


def test_no_start_is_fitted_twice(linear: SimulatedFit, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = fitted_shares(monkeypatch)
    score = Score(Term(PART, at_hz(5.0, 1e-6), (0,)), 1e3, 3, 1.0, 0.0)  # so light that no weaker start is tried
    joined_to(linear.problem, linear, score)
    begun = [share for ids, share, _ in seen if ids == ("attached_mass",)]
    assert begun.count(0.05) == 1


def test_beside_a_rival_no_other_start_is_tried_once_one_is_out_of_its_reach(linear: SimulatedFit) -> None:
    right = fit(linear.problem, (CUBED,), linear, staged=True)
    assert right.little_predicted
    scores = tuple(
        Score(SQUARED.within({"quadratic_damping_n_s2_per_m2": size}), 1e3, 1, 1.0, 0.0) for size in (0.5, 5.0)
    )
    ranking = Ranking((scores,), 1)
    asked: list[float] = []

    def joined(begun: SimulatedFit, score: Score, to_beat: float) -> SimulatedFit:
        asked.append(to_beat)
        return fit(linear.problem, (score.term,), begun, to_beat=to_beat)

    def race(problem: SimulatedRecordings, rival: SimulatedFit | None) -> None:
        asked.clear()
        Competition(problem, linear, rival).run(ranking, linear, joined, lambda told: None)

    race(linear.problem, right)
    assert asked == [EXPLAINED * right.objective]
    race(linear.problem, None)
    assert asked[0] == math.inf
