"""What noise of a measured force makes of a recording, of fits and of their intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import analysis.mismatch.recordings.model as model
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit, fit
from analysis.mismatch.recordings.input_noise import rms_of_inputs
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.made_ready import weighed
from analysis.mismatch.recordings.model import made_by_input_noise
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.score_test import screen
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input, recorded, sensor

RATE, SAMPLES = 240.0, 2400
MASS, STIFFNESS, DAMPING, CUBIC = 0.75, 5200.0, 2.1, 2.5e7
FORCE_NOISE = 0.006  # N
RIG = f"""
bodies: {{mass: {MASS}}}
springs: [{{name: leaf, between: [mass, ground], stiffness: unknown, damping: unknown}}]
inputs: [{{channel: 0, force_on: mass, noise: {FORCE_NOISE}}}]
"""


def force() -> Real:
    return 6 * noise_input(SAMPLES, RATE, 4, 30, seed=8)


def pulls(draws: int) -> Real:
    """Return (draws, 3) errors of stiffness, damping and cubic over their standard errors."""
    u = force()

    def acting(s: Real | float, x: Real, v: Real) -> Real:
        return (s - STIFFNESS * x - DAMPING * v - CUBIC * x**3) / MASS

    x, v = motion(acting, [0.0, 0.0], SAMPLES, RATE, u)
    rig = parse_rig(RIG + sensor("acceleration"))
    term = Term(catalogue()["tube_spring_cubic"][-1], {"cubic_stiffness_n_per_m3": CUBIC}, (0,))
    true = {"stiffness of leaf": STIFFNESS, "damping of leaf": DAMPING}
    found = []
    for seed in range(draws):
        noisy = u + FORCE_NOISE * np.random.default_rng(seed).normal(size=u.size)
        problem = problem_of(rig, [prepare(recorded([noisy, acting(u, x, v)], RATE, 0.002, 50 + seed), rig)])
        start = {**problem.constants, **true, "offset of input 1": 0.0}
        problem = replace(problem, constants=start, states=(np.zeros(2),))
        fitted = fit(weighed(fit(problem, (term,), fine=True)), (term,), fine=True)
        found.append(_pulls(fitted, {**true, **term.values}))
    return np.array(found)


def _pulls(fitted: SimulatedFit, true: Mapping[str, float]) -> list[float]:
    errors = np.sqrt(np.diag(fitted.covariance))
    by_name = {q.name: (q, fitted.x[i], errors[i]) for i, q in enumerate(fitted.simulation.parameters)}
    return [float((by_name[n][1] - by_name[n][0].inward(value)) / by_name[n][2]) for n, value in true.items()]


def test_draws_of_a_force_s_noise_have_the_variance_of_a_linear_rig() -> None:
    u = force()
    moved = motion(lambda s, x, v: (s - STIFFNESS * x - DAMPING * v) / MASS, [0.0, 0.0], SAMPLES, RATE, u)
    rig = parse_rig(RIG + sensor("displacement"))
    problem = problem_of(rig, [prepare(recorded([u, moved[0]], RATE, 0.002), rig)])
    fitted = fit(problem, fine=True)
    made = made_by_input_noise(fitted.simulation, fitted.x, fitted.own[0], 0)
    assert made is not None
    level = problem.recordings[0].unit[0]
    settled = made[:, 0, made.shape[2] // 2 :] * level
    expected = FORCE_NOISE**2 * 2 / RATE / (4 * DAMPING * STIFFNESS)  # of a mass on a spring under white noise
    assert np.mean(settled**2) == pytest.approx(expected, rel=0.25)  # 80 draws of about six correlation times


def test_draws_and_covariances_are_made_once_and_only_for_those_who_ask(monkeypatch: pytest.MonkeyPatch) -> None:
    u, asked = force(), []
    moved = motion(lambda s, x, v: (s - STIFFNESS * x - DAMPING * v) / MASS, [0.0, 0.0], SAMPLES, RATE, u)
    rig = parse_rig(RIG + sensor("displacement"))
    problem = problem_of(rig, [prepare(recorded([u, moved[0]], RATE, 0.002), rig)])
    simulated = model.drawn
    monkeypatch.setattr(model, "drawn", lambda *given: asked.append(1) or simulated(*given))  # type: ignore[func-returns-value]
    fitted = fit(problem, fine=True)
    assert not asked
    assert np.all(np.diag(fitted.covariance) > 0)
    assert fitted.noise(0).driven is not None
    there, own = fitted.x, fitted.own[0]
    again = made_by_input_noise(fitted.simulation, there, own, 0)
    assert len(asked) == 1
    elsewhere = made_by_input_noise(fitted.simulation, there + 1e-3, own, 0)
    assert len(asked) == 2
    assert again is not None
    assert elsewhere is not None
    assert not np.array_equal(again, elsewhere)


@pytest.mark.parametrize("kind", ["steps", "multisine"])
def test_the_noise_of_a_force_is_read_from_where_it_stands_still_or_has_no_lines(kind: str) -> None:
    rig = parse_rig(RIG.replace(f", noise: {FORCE_NOISE}", "") + sensor("displacement"))
    levels = np.repeat(np.random.default_rng(5).normal(0, 6, SAMPLES // 60), 60)
    clean = levels if kind == "steps" else force()
    found = []
    for seed in range(5):
        noisy = clean + FORCE_NOISE * np.random.default_rng(seed).normal(size=clean.size)
        found.append(rms_of_inputs(rig, prepare(recorded([noisy, force()], RATE, 0.0), rig))[0])
    assert np.mean(found) == pytest.approx(FORCE_NOISE, rel=0.05)


@pytest.mark.parametrize("measured", [False, True])
def test_a_staircase_has_no_noise_of_its_own_unless_it_was_measured(measured: bool) -> None:
    """Taken from its spectrum, which is that of the steps, it hid an end stop of three hundred standard deviations."""
    rig = parse_rig(RIG.replace(f", noise: {FORCE_NOISE}", "") + sensor("displacement"))
    random = np.random.default_rng(3)
    steps = np.repeat(random.uniform(-6.0, 6.0, 8), SAMPLES // 8)
    u = steps + (FORCE_NOISE * random.standard_normal(SAMPLES) if measured else 0.0)
    (found,) = rms_of_inputs(rig, prepare(recorded([u, force()], RATE, 0.0), rig))
    assert found == (pytest.approx(FORCE_NOISE, rel=0.15) if measured else 0.0)


@pytest.mark.parametrize("quantum", [0.0, 0.02])
def test_an_input_that_stands_exactly_still_between_its_pulses_is_known_to_its_rounding(quantum: float) -> None:
    rig, at = parse_rig(RIG.replace(f", noise: {FORCE_NOISE}", "") + sensor("displacement")), np.arange(SAMPLES)
    away = np.min(np.abs(at[:, None] - np.array([300, 1100, 1900])), axis=1)
    pulses = np.where(away < 40, 2.5 * (1 + np.cos(np.pi * away / 40)), 0.0)
    u = np.round(pulses / quantum) * quantum if quantum else pulses
    (found,) = rms_of_inputs(rig, prepare(recorded([u, force()], RATE, 0.0), rig))
    assert 0.1 * quantum <= found * np.sqrt(12) <= 1.01 * quantum


@pytest.mark.long
def test_intervals_beside_a_spring_that_bends_count_the_noise_of_the_force() -> None:
    found = pulls(draws=8)
    spread = np.sqrt(np.mean(found**2, axis=0))
    assert np.all(spread < 1.8)  # three times as far: six in a million by chance
    assert np.all(spread > 0.3)


def test_rankings_of_what_is_not_whitened_need_no_draws() -> None:
    rig = parse_rig(RIG + sensor("displacement"))
    u = force()
    moved = motion(lambda s, x, v: (s - STIFFNESS * x - DAMPING * v) / MASS, [0.0, 0.0], SAMPLES, RATE, u)
    noisy = u + FORCE_NOISE * np.random.default_rng(1).normal(size=u.size)
    problem = problem_of(rig, [prepare(recorded([noisy, moved[0]], RATE, 1e-4), rig)])
    fitted = fit(problem, fine=True)
    assert problem.draws(fitted) > 0
    known = [catalogue()["tube_spring_cubic"][-1]]
    assert screen(replace(problem, plain=True), fitted, known).scores
    assert screen(problem, fitted, known).p_value > 1e-4
