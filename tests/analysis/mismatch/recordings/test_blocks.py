from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.blocks import (
    chooses_no_worse,
    fall_in,
    fitted_where_odd,
    independent_samples,
    likelihood_ratio,
    mean_of,
    predicts_no_better,
    ratio_in,
    share_by_scores,
    untold_words,
)
from analysis.mismatch.recordings.fit import SimulatedFit, fit
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.made_ready import weighed
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, HELD, prepare
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate, State
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import family
from tests.analysis.mismatch.recordings.described_rigs import INPUT, SPRING, motion, noise_input, recorded, sensor

K, C, REACH, NOISE = 5700.0, 1.2, 0.01, 2e-4
SLOW = 0.8  # of the noise before, in the noise: 2.8 times what cannot be predicted of it


def with_and_without(cubic: float, seed: int) -> tuple[SimulatedFit, SimulatedFit]:
    """Return the linear rig and one with a cubic spring, fitted to a decay in slow noise."""
    decay = motion(lambda u, x, v: -K * x - C * v - cubic * x**3, [REACH, 0.0], 1500, 200.0)[0]
    noise = lfilter([1.0], [1.0, -SLOW], np.random.default_rng(seed).standard_normal(decay.size))
    rig = parse_rig(SPRING + sensor("displacement", 0))
    recording = Recording((decay + NOISE * noise / noise.std())[None], 200.0, ("c1",), "", "simulated")
    (law,) = family("tube_spring_cubic")
    with np.errstate(all="ignore"):
        first = problem_of(rig, [prepare(recording, rig)])
        problem = weighed(linear_fit(first))
        linear = linear_fit(problem)
        term = Term(law, {"cubic_stiffness_n_per_m3": cubic or 1e4}, (0,))
        return linear, fit(problem, (term,), linear, fine=True)


@pytest.mark.slow
def test_evidence_of_a_law_that_is_not_there_is_chi_squared() -> None:
    found = [ratio_in(FIT, before, after, after) for before, after in (with_and_without(0.0, s) for s in range(20))]
    # of one degree of freedom: 1 on average, with a standard deviation of 1.4
    assert abs(np.mean(found) - 1.0) < 3 * math.sqrt(2 / len(found))
    assert max(found) < 13.0  # its probability is 3e-4
    assert min(found) > -1e-3


def test_what_is_left_is_a_share_of_mean_squares() -> None:
    """As much left as the noise holds by itself is noise over all that the linear rig leaves, however large that is."""
    linear, bent = with_and_without(1e7, 1)
    before, after = (mean_of(f.by_block(FIT, bent)) for f in (linear, bent))
    count = sum(independent_samples(bent, part, True) for part in (FIT, CHOOSE))
    assert before > 10 * after
    assert share_by_scores(linear, bent, count) == pytest.approx(after / before, rel=0.3)
    assert share_by_scores(linear, bent, 0.0) == 0.0


def test_what_is_fast_counts_beside_slow_noise() -> None:
    linear, bent = with_and_without(3e5, 1)
    assert bent.scatter < bent.problem.policy.unlike_noise
    alike = sum(
        independent_samples(bent, part) * math.log(mean_of(linear.by_block(part)) / mean_of(bent.by_block(part)))
        for part in (FIT, CHOOSE)
    )
    found = likelihood_ratio(linear, bent, bent)
    # for each sample, power over what cannot be predicted: at 12 Hz of 200 much less noise than on average
    assert found > 1.5 * alike > 0
    term = bent.terms[0].values["cubic_stiffness_n_per_m3"]
    error = math.sqrt(float(bent.term_covariances[0][0, 0]))
    # the square of the law's size in standard errors, which are those of a fit that weighs all samples alike
    assert 0.9 < found / (term / error) ** 2 < 2.0


@pytest.mark.slow
def test_larger_held_out_errors_count_where_noise_alone_does_not_make_them() -> None:
    refused, larger, falls, expected = 0, 0, [], []
    for seed in range(10):
        before, after = (
            fit(f.problem, f.terms, f, parts=(FIT, CHOOSE), fine=True) for f in with_and_without(2e5, seed)
        )
        fall, made, by_chance = fall_in(HELD, before, after)
        assert untold_words(before, after) == "" or 0 < made < by_chance
        falls.append(fall)
        expected.append(made)
        refused += predicts_no_better(before, after)
        larger += fall < 0
    # what the law does there is about as much as noise: errors are larger in some of the recordings, by chance
    assert larger >= 3
    assert refused <= 1
    assert np.mean(falls) == pytest.approx(np.mean(expected), abs=3 * 2 * math.sqrt(np.mean(expected) / 10))


def test_larger_held_out_errors_count_where_they_are_beyond_noise() -> None:
    linear, bent = with_and_without(1e6, 1)
    assert predicts_no_better(bent, linear)
    assert not predicts_no_better(linear, bent)
    assert not untold_words(linear, bent)


def test_choosing_blocks_in_which_nothing_happens_do_not_refuse() -> None:
    linear, bent = with_and_without(1e6, 1)
    assert chooses_no_worse(linear, bent)
    assert not chooses_no_worse(bent, linear)


def test_what_is_odd_where_it_was_held_out_is_fitted() -> None:
    u = noise_input(2400, 200.0, 0.5, 40, seed=8)
    rig = parse_rig(SPRING + INPUT + sensor("displacement", 1))
    x = motion(lambda s, x, v: 100 * s - 5700 * x - 1.2 * v, [0.0, 0.0], 2400, 200.0, u)[0]
    part = prepare(recorded([u, x], 200.0, 1e-3), rig).part
    peak = int(np.argmax(np.abs(x) * (part == HELD)))
    x[peak] *= 0.8  # all that is wrong
    with np.errstate(all="ignore"):
        problem = problem_of(rig, [prepare(recorded([u, x], 200.0, 1e-3), rig)])
        divided = fitted_where_odd(linear_fit(problem), problem.recordings)
    assert problem.recordings[0].part[peak] == HELD
    assert divided[0].part[peak] == FIT
    assert sorted(divided[0].part) == sorted(problem.recordings[0].part)


@pytest.mark.slow
def test_choosing_blocks_refuse_by_chance_in_one_of_a_hundred() -> None:
    pairs = [with_and_without(0.0, seed) for seed in range(20)]
    assert all(chooses_no_worse(before, after) for before, after in pairs)


def test_what_noise_hides_where_it_was_held_out_is_said() -> None:
    linear, bent = with_and_without(1e5, 1)
    assert "noise hides" in untold_words(linear, bent)


@pytest.mark.parametrize(("evidence", "accepted"), [(1.5, False), (30.0, True)])
def test_where_only_noise_is_missed_better_blocks_are_not_enough(evidence: float, accepted: bool) -> None:
    linear, bent = with_and_without(0.0, 1)
    judge = BlockJudge(linear.problem, [])
    screening = judge.screen(linear)
    better = tuple(share * loss for share, loss in zip((0.90, 0.91, 0.89) * 2, linear.by_block(CHOOSE), strict=True))
    candidate = Candidate(Score(bent.terms[0], 0.0, 1, 0.0, 1.0), bent, evidence, losses=better)
    found, _ = judge.accepts(State(linear, screening), [candidate])
    assert (found is candidate) == accepted
