"""What a fit leaves has the colour of a sensor's noise, or it rings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from analysis.mismatch.recordings.blocks import independent_samples, likelihood_ratio, of_least_noise, p_of_colour
from analysis.mismatch.recordings.fit import SimulatedFit, fit
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.noise_colour import p_of_sensor_noise
from analysis.mismatch.recordings.recorded import CHOOSE, prepare
from analysis.mismatch.selection import Candidate, SelectionStep, State, screened_baseline
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.described_rigs import (
    INPUT,
    OMEGA,
    RATE,
    SAMPLES,
    SPRING,
    driven,
    duffing,
    motion,
    noise_input,
    sensor,
)
from tests.analysis.terms import at_work

RIG = parse_rig(SPRING + INPUT + sensor("displacement"))


def beside(noise: Real) -> SimulatedFit:
    """Return the linear rig's fit to a driven mass whose displacement has this beside it, over its rms."""
    u, x, _ = driven()
    data = np.array([u, x + x.std() * noise])
    return linear_fit(problem_of(RIG, [prepare(Recording(data, RATE, ("u", "x"), "", "made"), RIG)]))


def first_order(correlated: float, seed: int) -> Real:
    """Return noise of unit variance whose neighbouring samples are correlated so much."""
    white = np.random.default_rng(seed).normal(size=SAMPLES + 500)
    return signal.lfilter([np.sqrt(1 - correlated**2)], [1, -correlated], white)[500:]


@pytest.mark.slow
def test_noise_of_sensors_is_found_to_be_that_as_often_as_it_says() -> None:
    random = np.random.default_rng(3)
    found = []
    for seed in range(24):
        white, slow = np.exp(random.uniform(-7, -3)), np.exp(random.uniform(-7, -3))
        noise = white * np.random.default_rng([seed, 1]).normal(size=SAMPLES)
        found.append(p_of_sensor_noise(beside(noise + slow * first_order(random.uniform(0.2, 0.98), seed))))
    assert np.mean(np.array(found) < 0.1) <= 0.29  # of 24: of more than 7 the probability is 0.002
    assert min(found) > 1e-4


@pytest.mark.parametrize("share", [0.02, 0.05])
def test_what_rings_is_no_noise_of_a_sensor(share: float) -> None:
    ringing = signal.lfilter(
        [1], np.poly(0.995 * np.exp([0.4j, -0.4j])).real, np.random.default_rng(2).normal(size=SAMPLES)
    )
    fitted = beside(share * ringing / ringing.std() + 1e-3 * np.random.default_rng(4).normal(size=SAMPLES))
    assert p_of_colour(fitted)[0] < 1e-9


def test_it_counts_only_where_errors_are_far_over_what_cannot_be_predicted() -> None:
    assert p_of_colour(beside(0.01 * np.random.default_rng(6).normal(size=SAMPLES))) == ()


def test_where_nothing_moves_no_colour_is_told_and_that_is_no_noise() -> None:
    fitted = beside(0.01 * np.random.default_rng(6).normal(size=SAMPLES))
    off, at = fitted.off(0)
    fitted.kept[0, False] = np.full_like(off, 1e3), at  # as of a rig too stiff to be stepped
    assert np.isnan(p_of_sensor_noise(fitted))
    far = replace(fitted, scatter=1e6)
    far.kept[0, False] = fitted.kept[0, False]
    assert not far.as_noise


@pytest.mark.slow
def test_slow_noise_is_noise_and_what_is_fast_is_weighed_beside_it() -> None:
    recording = duffing(noise_input(SAMPLES, RATE, 2, 25, seed=3))
    data = recording.data.copy()
    data[1] += 2 * data[1].std() * first_order(0.995, 8)  # of which a 65th cannot be predicted
    rig = parse_rig(SPRING + INPUT + sensor("velocity"))
    problem = problem_of(rig, [prepare(replace(recording, data=data), rig)])
    linear = BlockJudge.of(problem, []).baseline()
    term = at_work("tube_spring_cubic", {"cubic_stiffness_n_per_m3": 4e4})
    cubic = fit(linear.problem, (replace(term, place=(0,)),), linear, fine=True)
    assert cubic.as_noise
    assert not linear.as_noise
    assert not cubic.little_predicted
    assert of_least_noise((linear, cubic)) is cubic
    assert likelihood_ratio(linear, cubic, cubic) > 500
    # as they are, slow noise hides it: there are no more independent samples than slow swings
    assert independent_samples(cubic) * np.log(linear.scatter / cubic.scatter) < 1


def pushed_unseen(knock: float = 0.0) -> Recording:
    """Return a driven mass that an unmeasured force of wandering frequency pushes, too; and a knock (N)."""
    u, _, _ = driven()
    t = np.arange(SAMPLES) / RATE
    wandering = 2 * np.pi * 14 * t + np.cumsum(0.05 * np.random.default_rng(8).normal(size=SAMPLES))
    pushed = 100 * u + 15 * np.sin(wandering)
    pushed[SAMPLES // 3 :][:8] += knock
    x, _ = motion(lambda s, x, v: s - OMEGA**2 * x - 0.08 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, pushed)
    noisy = x + 2e-3 * x.std() * np.random.default_rng(9).normal(size=SAMPLES)
    return Recording(np.array([u, noisy]), RATE, ("u", "x"), "", "made")


@pytest.mark.slow
def test_a_force_that_no_input_shows_is_not_taken_for_noise() -> None:
    """An autoregression foretold it: nothing was left beyond noise, with held-out errors of eight times that."""
    judge = BlockJudge.of(problem_of(RIG, [prepare(pushed_unseen(), RIG)]), variants(catalogue()))
    assert screened_baseline(judge).screening.p_value < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("mechanism", ["knock", "tube_spring_cubic"])
def test_what_leaves_most_of_it_is_not_named(mechanism: str) -> None:
    judge = BlockJudge.of(problem_of(RIG, [prepare(pushed_unseen(400.0), RIG)]), variants(catalogue()))
    baseline = screened_baseline(judge)
    score = next(s for s in baseline.screening.scores if s.term.mechanism.id == mechanism)
    fitted = judge.fitted_alone(baseline.current, [score])
    assert fitted is not None
    accepted = Candidate(score, fitted, 100.0, losses=fitted.by_block(CHOOSE))
    step = SelectionStep(baseline.current, baseline.screening, (accepted,), accepted)
    state = State(fitted, judge.screen(fitted), (step,))
    found = judge.outcome(baseline, state)
    assert (found.chosen, found.best.terms[0].mechanism.id) == (None, mechanism)
    assert 0.5 < found.left.share <= 1
    allowing = judge.knowing(judge.known, replace(judge.problem.policy, mostly_left=1.1))
    assert allowing.outcome(baseline, state).chosen is not None
