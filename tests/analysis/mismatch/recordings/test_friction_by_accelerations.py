"""Dry friction that accelerometers see: intervals from what its size does, not from jumps that pass a sample."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit, fit
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.nearby import BESIDE, beside_jumps, nearby
from analysis.mismatch.recordings.recorded import prepare
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from tests.analysis.terms import listed
from tests.sim_backend.exact_friction import exact_motion

RATE, SAMPLES, STEPS = 2000.0, 2400, 2  # Hz; steps of the exact motion in a sample
MASS, STIFFNESS, DAMPING, FRICTION = 0.9, 9000.0, 2.0, 1.2
RIG = parse_rig(
    "bodies: {m: 0.9}\nsprings: [{name: s, between: [m, ground], stiffness: unknown, damping: unknown}]\n"
    "inputs: [{channel: u, force_on: m, gain: 1}]\nsensors: [{channel: a, of: m, shows: acceleration}]\n"
)


def exact(friction: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return force, speed and acceleration under a sweep from 4 to 40 Hz, from event to event."""
    h = 1 / RATE / STEPS
    t = np.arange(2 * STEPS * (SAMPLES - 1) + 1) * h / 2
    force = 8 * np.sin(2 * np.pi * (4 * t + 18 * t**2 / (SAMPLES / RATE)))
    rig = np.array([MASS]), np.array([[DAMPING]]), np.array([[STIFFNESS]])
    x, v = exact_motion(rig, np.ones(1), np.ones(1), friction, force, h)[::STEPS].T
    free = force[:: 2 * STEPS] - STIFFNESS * x - DAMPING * v
    rubs = np.where(np.abs(v) > 1e-12, friction * np.sign(v), np.clip(free, -friction, friction))
    return force[:: 2 * STEPS], v, (free - rubs) / MASS


def swept(noise: float, seed: int) -> tuple[Recording, np.ndarray]:
    """Return a recording of the acceleration, and the true speed."""
    force, v, a = exact(FRICTION)
    a = a + noise * a.std() * np.random.default_rng(seed).standard_normal(a.size)
    return Recording(np.vstack([force, a]), RATE, ("u", "a"), "", "swept"), v


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3))])
def test_the_interval_of_friction_is_what_its_size_tells(seed: int) -> None:
    recording, _ = swept(0.03, seed)
    answer = diagnose_recordings([recording], RIG, [listed("guide_friction")], learn=False).answer
    assert [m.id for m in answer.mechanisms] == ["guide_friction"]
    found = answer.mechanisms[0].parameters["friction_force_n"]
    assert found.low < FRICTION < found.high
    # what it tells in white noise were nothing else unknown, but for jumps that pass a sample
    more, less = (exact(f * FRICTION)[2] for f in (1.0005, 0.9995))
    slope = np.where(np.abs(more - less) < FRICTION / MASS, (more - less) / (1e-3 * FRICTION), 0.0)
    least = 2 * 1.96 * 0.03 * exact(FRICTION)[2].std() / np.linalg.norm(slope)
    assert least < found.high - found.low < 10 * least  # the damper does much of the same
    assert answer.remainder.p_value > 0.01


def test_differences_are_taken_of_no_sample_next_to_a_jump() -> None:
    recording, v = swept(1e-3, 4)
    problem = problem_of(RIG, [prepare(recording, RIG)])
    term = Term(listed("guide_friction"), {"friction_force_n": FRICTION, "rounding": 1e-8}, (0,))
    fitted: SimulatedFit = fit(problem, (term,))
    beside = beside_jumps(nearby(fitted.simulation, fitted.x, fitted.own[0], 0))
    assert beside.shape == (1, SAMPLES)
    turned = np.flatnonzero((v[1:] * v[:-1] < 0) & (np.abs(v[1:]) > 1e-3) & (np.abs(v[:-1]) > 1e-3))
    assert turned.size > 20
    near = turned[:, None] + np.arange(1 - BESIDE, BESIDE + 1)
    assert np.mean(beside[0, near]) > 0.95  # the fitted rig turns where the true one does, but for a sample
    assert np.mean(beside) < 0.3
