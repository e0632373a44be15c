"""How loud a hum is said to be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import fit
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, prepare
from analysis.mismatch.recordings.tones import loudest_tone
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.mains_hum import MECHANISM
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input, recorded, sensor

RATE, SAMPLES, OMEGA = 240.0, 1500, 2 * np.pi * 12
RIG = f"""
bodies: {{mass: 1}}
springs: [{{name: leaf, between: [mass, ground], stiffness: {OMEGA**2}, damping: unknown}}]
inputs: [{{channel: 0, force_on: mass, noise: 0}}]
"""
AMPLITUDE, NOISE, DRAWS = 4e-5, 5e-5, 24
HUM = Term(MECHANISM, {"mains_hz": 50.0, "lines": 1.0, "amplitude_m_s2": 0.0}, ())


def white(random: np.random.Generator) -> np.ndarray:
    return random.standard_normal(SAMPLES)


def slow(random: np.random.Generator) -> np.ndarray:
    """Noise of which there is less at 50 Hz than on average."""
    return lfilter([np.sqrt(1 - 0.8**2)], [1.0, -0.8], random.standard_normal(SAMPLES))


@pytest.mark.long
@pytest.mark.parametrize("drawn", [white, slow])
def test_the_error_of_a_hums_amplitude_is_as_large_as_is_said(drawn: Callable[..., np.ndarray]) -> None:
    rig, off = parse_rig(RIG + sensor("displacement")), []
    t = np.arange(SAMPLES) / RATE
    forces = [300 * noise_input(SAMPLES, RATE, 4, 30, seed) for seed in (1, 2, 3)]
    still = [motion(lambda s, x, v: s - OMEGA**2 * x - 3.0 * v, [0.0, 0.0], SAMPLES, RATE, u)[0] for u in forces]
    for seed in range(DRAWS):
        random = np.random.default_rng(seed)
        made = []
        for u, y in zip(forces, still, strict=True):
            hum = AMPLITUDE * np.sin(2 * np.pi * 50 * t + random.uniform(0, 2 * np.pi))
            made.append(prepare(recorded([u, y + hum + NOISE * drawn(random)], RATE, 0.0), rig))
        problem = problem_of(rig, made)
        amplitude, error, _ = loudest_tone(fit(problem, (HUM,), fit(problem), fine=True, parts=(FIT, CHOOSE)))
        off.append((amplitude - AMPLITUDE) / error)
    assert abs(np.mean(off)) < 3 / np.sqrt(DRAWS)
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5
