"""What noise of a measured force makes of a recording, of fits and of their intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit, fit, problem_of
from analysis.mismatch.recordings.model import made_by_input_noise
from analysis.mismatch.recordings.recorded import prepare
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input, recorded, sensor

RATE, SAMPLES = 200.0, 1600
MASS, STIFFNESS, DAMPING, CUBIC, FRICTION = 1.3, 4100.0, 3.5, 2.5e7, 0.8
TURNS_WITHIN = 5e-4  # m/s
FORCE_NOISE = 0.006  # N
RIG = f"""
bodies: {{mass: {MASS}}}
springs: [{{name: leaf, between: [mass, ground], stiffness: unknown, damping: unknown}}]
inputs: [{{channel: 0, force_on: mass, noise: {FORCE_NOISE}}}]
"""


def force() -> Real:
    return 6 * noise_input(SAMPLES, RATE, 3, 22, seed=8)


def friction(v: Real) -> Real:
    return FRICTION * np.tanh(v / TURNS_WITHIN)


def pulls(mechanism: str, values: dict[str, float], law: object, draws: int) -> Real:
    """Return (draws, 3) errors of stiffness, damping and strength over their standard errors."""
    u = force()
    x, v = motion(lambda s, x, v: (s - STIFFNESS * x - DAMPING * v - law(x, v)) / MASS, [0.0, 0.0], SAMPLES, RATE, u)
    seen = (u - STIFFNESS * x - DAMPING * v - law(x, v)) / MASS
    rig = parse_rig(RIG + sensor("acceleration"))
    term = Term(catalogue()[mechanism][-1], values, (0,))
    true = {"stiffness of leaf": STIFFNESS, "damping of leaf": DAMPING}
    found = []
    for seed in range(draws):
        noisy = u + FORCE_NOISE * np.random.default_rng(seed).normal(size=u.size)
        problem = problem_of(rig, [prepare(recorded([noisy, seen], RATE, 0.002, 50 + seed), rig)])
        offset = {"offset of input 1": 0.0}
        problem = replace(problem, constants={**problem.constants, **true, **offset}, states=(np.zeros(2),))
        fitted = fit(problem.weighed(fit(problem, (term,), fine=True)), (term,), fine=True)
        found.append(_pulls(fitted, {**true, next(iter(values)): next(iter(values.values()))}))
    return np.array(found)


def _pulls(fitted: SimulatedFit, true: dict[str, float]) -> list[float]:
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
    assert np.mean(settled**2) == pytest.approx(expected, rel=0.25)  # 40 draws of about six correlation times


@pytest.mark.slow
def test_intervals_beside_a_spring_that_bends_count_the_noise_of_the_force() -> None:
    found = pulls("tube_spring_cubic", {"cubic_stiffness_n_per_m3": CUBIC}, lambda x, v: CUBIC * x**3, draws=8)
    spread = np.sqrt(np.mean(found**2, axis=0))
    assert np.all(spread < 1.8)  # three times as far: six in a million by chance
    assert np.all(spread > 0.3)


@pytest.mark.slow
def test_intervals_beside_dry_friction_count_that_the_noise_of_the_force_moves_its_jumps() -> None:
    values = {"friction_force_n": FRICTION, "rounding": TURNS_WITHIN}
    found = pulls("guide_friction", values, lambda x, v: friction(v), draws=8)
    spread = np.sqrt(np.mean(found**2, axis=0))
    assert np.all(spread < 1.8)
    assert np.all(spread > 0.3)
