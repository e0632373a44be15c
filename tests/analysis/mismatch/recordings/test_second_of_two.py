"""A second mechanism beside one that has lost the phase; the recording by SciPy's own integrator."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import fit
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.score_test import Score
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue
from tests.analysis.mismatch.recordings.described_rigs import motion, sensor

RATE, SAMPLES, SEED = 240.0, 3360, 2  # one of the first three seeds in which no other start does
MASS, STIFFNESS, DAMPING, CUBIC, FRICTION, TURNS_WITHIN = 0.75, 5200.0, 2.1, 5e7, 0.8, 5e-4
RIG = f"""
bodies: {{mass: {MASS}}}
springs: [{{name: leaf, between: [mass, ground], stiffness: unknown, damping: unknown}}]
inputs: [{{channel: 0, force_on: mass}}]
"""


@pytest.mark.slow
def test_friction_is_found_beside_a_spring_that_bends_in_a_driven_rig() -> None:
    u = multisine(SEED)

    def acting(s, x, v):  # type: ignore[no-untyped-def]
        friction = FRICTION * np.tanh(v / TURNS_WITHIN)
        return (s - STIFFNESS * x - DAMPING * v - CUBIC * x**3 - friction) / MASS

    x, v = motion(acting, [0.0, 0.0], SAMPLES, RATE, u)
    seen = acting(u, x, v)
    seen += 0.002 * np.std(seen) * np.random.default_rng(3).normal(size=SAMPLES)
    rig = parse_rig(RIG + sensor("acceleration"))
    problem = problem_of(rig, [prepare(Recording(np.array([u, seen]), RATE, ("u", "a"), "", "simulated"), rig)])
    judge = BlockJudge.of(problem, [])
    cubic = Term(catalogue()["tube_spring_cubic"][-1], {"cubic_stiffness_n_per_m3": 1e6}, (0,))
    friction = Term(catalogue()["guide_friction"][-1], {"friction_force_n": 0.1, "rounding": 1e-3}, (0,))
    first = fit(judge.problem, (cubic,), judge.baseline())
    both = judge.fitted_alone(first, [Score(friction, 0.0, 1, 1.0, 0.0)])
    assert both is not None
    assert both.scatter < 1e-3 * first.scatter
    values = {name: value for term in both.terms for name, value in term.values.items()}
    assert values["cubic_stiffness_n_per_m3"] == pytest.approx(CUBIC, rel=2e-3)
    assert values["friction_force_n"] == pytest.approx(FRICTION, rel=5e-3)


def multisine(seed: int) -> Real:
    """Eighty lines from 4 to 30 Hz in a period as long as the recording, with an rms of 6 N."""
    t, random = np.arange(SAMPLES) / RATE, np.random.default_rng(seed)
    hz = np.unique(np.round(np.linspace(4, 30, 80) * SAMPLES / RATE)) * RATE / SAMPLES
    u = np.sum(np.cos(2 * np.pi * hz[:, None] * t + random.uniform(0, 2 * np.pi, (hz.size, 1))), axis=0)
    return np.asarray(6 * u / np.std(u), np.float64)
