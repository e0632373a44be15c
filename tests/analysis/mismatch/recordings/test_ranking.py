"""From which trials a screened mechanism is fitted."""

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import POLICY
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.racing import EXPLAINED, HOPELESS, converged, from_starts, to_beat, within_reach
from analysis.mismatch.recordings.ranking import BENT_APART, VARIANTS, Ranking
from analysis.mismatch.recordings.recorded import CHOOSE, FIT
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate
from sim_backend.mechanisms.catalogue import catalogue, family, variants

FORCE, RANGE, SPEED = "meniscus_force_share", "meniscus_range_share", "sets_in_m_per_s"
(MENISCI,) = (m for m in family("menisci") or ())


def scored(gain: float, reach: float, speed: float = 1e-3, force: float = 1e-3) -> Score:
    return Score(Term(MENISCI, {FORCE: force, RANGE: reach, SPEED: speed}, (0,)), gain, 1, 0.0, 1.0)


def kept(*scores: Score) -> list[float]:
    return [s.gain for s in Ranking.of(scores, POLICY, 0.0).scores[0]]


def test_a_law_may_begin_from_trials_that_differ_in_more_than_its_strength() -> None:
    assert kept(scored(60, 1.0), scored(50, 0.1), scored(40, 1.0, speed=1e-2)) == [60, 50, 40]
    assert kept(scored(60, 1.0), scored(50, 1.0, force=1e-2)) == [60]
    near = math.exp(0.9 * BENT_APART)
    assert kept(scored(60, 1.0), scored(50, near)) == [60]


def test_a_trial_that_promises_little_is_no_start_and_no_more_are_than_so_many() -> None:
    assert kept(scored(60, 1.0), scored(0.9 * POLICY.other_start * 60, 0.1)) == [60]
    assert len(kept(*(scored(60 - k, 10.0**-k) for k in range(VARIANTS + 2)))) == VARIANTS


def ended(*fits: tuple[float, bool], hopeless: float = math.inf) -> tuple[float, int]:
    """Return the error of the best of fits of given error that ended at a bound or not, and how many were begun."""
    scores = [scored(60 - k, 10.0**-k) for k in range(len(fits))]
    begun: list[Score] = []

    def fitted_from(score: Score) -> SimulatedFit:
        error, at_bound = fits[scores.index(score)]
        begun.append(score)
        made = SimpleNamespace(
            scatter=error, objective=error, pinned=lambda: at_bound, problem=SimpleNamespace(policy=POLICY)
        )
        return cast("SimulatedFit", made)

    return from_starts(scores, fitted_from, hopeless)[1].scatter, len(begun)


def test_a_law_that_ends_at_a_bound_begins_anew() -> None:
    assert ended((0.95, True), (0.91, False), (0.90, False)) == (0.91, 2)
    assert ended((0.95, False), (0.91, False)) == (0.95, 1)
    assert ended((0.95, True), (0.97, True), (0.96, True)) == (0.95, 3)


def test_an_end_at_a_bound_counts_as_a_larger_error() -> None:
    assert ended((0.90, True), (0.95, False))[0] == 0.95
    assert ended((0.90, True), (1.1 * POLICY.in_time * 0.90, False))[0] == 0.90


def test_no_further_start_where_the_first_has_led_nowhere() -> None:
    assert ended((9.0, True), (0.9, False), hopeless=4.0) == (9.0, 1)


GAINS = (60.0, 20.0, 12.0)


def test_beside_what_is_as_good_as_noise_only_what_promises_enough_earns_a_fit() -> None:
    laws = variants(catalogue())[: len(GAINS)]
    few = [Score(Term(m, {}, (i,)), gain, 1, 0.0, 1.0) for i, (m, gain) in enumerate(zip(laws, GAINS, strict=True))]
    ranking = Ranking.of(few, POLICY, 0.0)
    assert ranking.finalists == 3
    assert [ranking.of_at_least(gain).finalists for gain in (10.0, 12.5, 30.0, 70.0)] == [3, 2, 1, 0]
    assert ranking.of_at_least(70.0).scores == ranking.scores


def leaving(scatter: float, noise: bool = False, terms: int = 1) -> Any:
    """Return a fit that leaves so much, or noise alone, with so many mechanisms."""
    return SimpleNamespace(
        scatter=scatter, objective=scatter, as_noise=noise, little_predicted=noise, terms=(0,) * terms
    )


def reached(*fits: tuple[float, float], noise: bool) -> list[int]:
    candidates = [Candidate(scored(60, 1.0), leaving(scatter, noise), evidence) for evidence, scatter in fits]
    return within_reach(candidates, POLICY)


def test_beside_what_leaves_noise_alone_few_are_in_reach() -> None:
    far, near = 0.9 * POLICY.hopeful * 5000, 1.1 * POLICY.hopeful * 5000
    assert reached((5000, 1.0), (near, 1.4), (far, 1.7), noise=True) == [0, 1]
    assert reached((5000, 1.0), (near, 1.4), (far, 1.7), noise=False) == [0, 1, 2]
    assert reached((5000, 1.0), (4900, 1.1 * HOPELESS), noise=False) == [0]
    assert reached((-3, 1.0), (-4, 1.0), noise=True) == [0]  # the best is in any case
    assert reached(noise=True) == []


def test_a_further_mechanism_has_to_come_nearer_once_one_leaves_noise_alone() -> None:
    begun = leaving(10.0, terms=1)
    assert to_beat(begun, begun) == math.inf
    assert to_beat(leaving(2.0, noise=False, terms=2), begun) == 2 * HOPELESS
    assert to_beat(leaving(2.0, noise=True, terms=2), begun) == 2 * EXPLAINED
    assert (
        to_beat(leaving(2.0, noise=True, terms=1), leaving(10.0, terms=0)) == 2 * HOPELESS
    )  # a first one looks like others


def test_a_rival_is_fitted_further_only_as_far_as_it_may_still_be_as_likely() -> None:
    """A friction beside the cubic spring of an oscillator took 100 steps of three seconds towards 3 % more error."""
    beats: list[float] = []

    def polished(fitted: Any, to_beat: float) -> Any:
        beats.append(to_beat)
        return white(0.9 * fitted.objective)

    fits = [(scored(60, 1.0), white(square)) for square in (500.0, 510.0, 520.0, 530.0)]
    found = converged(fits, {0, 1, 3}, {3}, polished)
    assert [one.objective for _, one in found] == [450.0, 459.0, 520.0, 477.0]
    as_likely = 450.0 * math.exp(POLICY.certain_by_blocks / 1000)
    assert beats == [math.inf, pytest.approx(as_likely, rel=0.05), math.inf]


def white(square: float) -> Any:
    """Return a fit that leaves a sum of squares of 1,000 independent samples, half of them in blocks that choose."""
    off = np.random.default_rng(3).standard_normal((1, 1000)) * math.sqrt(square / 1000)
    part = np.array([FIT, CHOOSE])[np.arange(1000) // 100 % 2]
    return SimpleNamespace(
        objective=square,
        scatter=square,
        pinned=lambda: False,
        problem=SimpleNamespace(policy=POLICY, recordings=[SimpleNamespace(part=part)]),
        off=lambda number: (off, slice(0, 1000)),
        by_block=lambda part: (square / 1000,) * 5,
    )
