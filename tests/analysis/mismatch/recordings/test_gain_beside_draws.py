"""Gains of mechanisms beside what noise of an input makes, over draws of that noise from outside."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.blocks import likelihood_ratio
from analysis.mismatch.recordings.fit import fit
from analysis.mismatch.recordings.gain_beside_draws import gain_beside_draws
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.made_ready import made_ready
from analysis.mismatch.recordings.recorded import prepare
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, family
from tests.analysis.mismatch.recordings.described_rigs import OMEGA, motion, noise_input

Real = NDArray[np.float64]
SAMPLES, RATE, RATIO = 2400, 600.0, 0.01
FORCE_NOISE, NOISE = 0.05, 0.02  # of the force and, over their rms, of the channels
RIG = parse_rig(f"""
bodies: {{mass: 1}}
springs: [{{between: [mass, ground], damping: unknown}}]
inputs: [{{channel: u, force_on: mass, offset: 0, noise: {FORCE_NOISE}}}]
sensors:
- {{channel: x, of: mass, shows: displacement, offset: 0}}
- {{channel: v, of: mass, shows: velocity, offset: 0}}
""")
(CUBIC,) = family("tube_spring_cubic") or ()
CUBED = "cubic_stiffness_n_per_m3"


@cache
def driven(cubed: float) -> tuple[Real, Real]:
    """Return a force (n,) and states (2, n) of a mass on a spring."""
    u = noise_input(SAMPLES, RATE, 2, 30, seed=3)
    return u, motion(lambda f, x, v: f - OMEGA**2 * x - 2 * RATIO * OMEGA * v - cubed * x**3, [0, 0], SAMPLES, RATE, u)


def gains(cubed: float, seed: int) -> tuple[float, float]:
    """Return by how much a cubic spring is better, by the draws and by the mean squares of what is left."""
    u, states = driven(cubed)
    random = np.random.default_rng([seed, 185])
    rows = np.stack([u, *(states + NOISE * states.std(axis=1, keepdims=True) * random.normal(size=states.shape))])
    rows[0] += FORCE_NOISE * random.normal(size=SAMPLES)
    recording = Recording(rows, RATE, ("u", "x", "v"), "", "driven")
    with np.errstate(all="ignore"):
        problem = made_ready(problem_of(RIG, [prepare(recording, RIG)]), catalogue())
        linear = linear_fit(problem)
        better = fit(problem, (Term(CUBIC, {CUBED: 1e3}, (0,)),), linear, fine=True)
        assert linear.as_noise == (cubed == 0)
        return gain_beside_draws(linear, better), likelihood_ratio(linear, better, better)


def test_of_a_sound_rig_a_parameter_gains_one_on_average() -> None:
    beside_draws, by_squares = np.mean([gains(0.0, seed) for seed in range(6)], axis=0)
    assert beside_draws < 3
    assert by_squares > 5  # the test can fail: what noise of the input makes is counted as white


def test_an_effect_gains_far_more() -> None:
    size = float(np.std(driven(0.0)[1][0]))
    assert gains(0.5 * OMEGA**2 / size**2, 0)[0] > 100
