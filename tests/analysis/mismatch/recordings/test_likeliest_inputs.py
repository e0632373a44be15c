"""Inputs with noise: what is taken off them, and what is still found in rigs that are driven in a band."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.recordings.fit import problem_of
from analysis.mismatch.recordings.input_noise import likeliest, rms_of_inputs
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.selection import screened_baseline
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.described_rigs import noise_input

RATE, SAMPLES, RISE = 2000.0, 4000, 40
MASSES, RATIO = np.array([0.9, 0.6, 0.35]), 0.018
RIG = parse_rig("""
bodies: {base: 0.9, middle: 0.6, top: 0.35}
joints:
- {name: foot, between: [base, ground]}
- {name: waist, between: [middle, base]}
- {name: neck, between: [top, middle]}
inputs: [{channel: force, force_on: top, offset: 0}]
sensors:
- {channel: a, of: base, shows: acceleration}
- {channel: b, of: middle, shows: acceleration}
- {channel: c, of: top, shows: acceleration}
recording: {hold: band-limited}
""")


def force_in_a_band(seed: int, size: int = 2 * SAMPLES) -> Real:
    """Return a force up to 0.2 of the rate that begins at rest and is over in the middle."""
    t = np.arange(size)
    inside = np.clip(np.minimum(t, SAMPLES - t) / RISE, 0.0, 1.0)
    return noise_input(size, RATE, 20, 400, seed) * np.sin(np.pi / 2 * inside) ** 2


def chain(first_hz: float, seed: int, share: float, sensors_share: float = 3e-3) -> Recording:
    """Return a recording of three bodies in a row, solved line by line; of the force a share of its rms is noise."""
    across = np.array([[1.0, 0, 0], [-1, 1, 0], [0, -1, 1]])
    stiffness = MASSES * (2 * np.pi * np.array([95.0, 170.0, 260.0])) ** 2
    damping = across.T @ np.diag(2 * RATIO * np.sqrt(stiffness * MASSES)) @ across
    whole = across.T @ np.diag(stiffness) @ across
    slowest = np.sqrt(np.linalg.eigvals(whole / MASSES[:, None]).real.min())
    faster = 2 * np.pi * first_hz / slowest
    size = 4 * SAMPLES  # of which the second half is at rest again: periodic
    u = np.concatenate([force_in_a_band(seed), np.zeros(size - 2 * SAMPLES)])
    s = 2j * np.pi * np.fft.rfftfreq(size, 1 / RATE)[:, None, None]
    answer = np.linalg.inv(whole * faster**2 + s * damping * faster + s**2 * np.diag(MASSES))[:, :, 2] * s[:, :, 0] ** 2
    seen = np.fft.irfft(np.fft.rfft(u)[:, None] * answer, size, axis=0)[: SAMPLES - 2 * RISE].T
    random, force = np.random.default_rng([seed, 1]), u[: SAMPLES - 2 * RISE]
    rows = np.stack([force + share * force.std() * random.normal(size=force.size), *seen])
    rows[1:] += sensors_share * np.std(rows[1:], axis=1, keepdims=True) * random.normal(size=rows[1:].shape)
    return Recording(rows, RATE, ("force", "a", "b", "c"), "", "chain")


@pytest.mark.parametrize("share", [0.005, 0.05])
def test_what_is_taken_off_an_input_is_its_noise_where_it_has_nothing_else(share: float) -> None:
    force = noise_input(SAMPLES, RATE, 20, 400, seed=4)
    measured = force + share * np.random.default_rng(9).normal(size=SAMPLES)
    inner = slice(200, -200)
    left = np.std((likeliest(measured, share) - force)[inner]) / share
    assert left == pytest.approx(np.sqrt(380 / 1000), rel=0.08)  # the band's own noise stays


def test_edges_stay_as_they_were_measured_and_taps_as_they_were() -> None:
    t, noise = np.arange(SAMPLES), 0.02 * np.random.default_rng(2).normal(size=SAMPLES)
    edges = np.where((t // 500) % 2, 1.0, -1.0) + noise
    assert likeliest(edges, 0.02) is edges
    taps = 50.0 * np.isin(t % 900, (100, 101, 102))
    assert np.abs(likeliest(taps + noise, 0.02) - taps).max() < 5 * 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("first_hz", "seed", "share"), [(182.0, 501, 0.005), (103.0, 708, 0.05)])
def test_a_sound_rig_driven_in_a_band_is_found_sound(first_hz: float, seed: int, share: float) -> None:
    """Beyond the band the noise of the force seems to drive a rig that does not answer: relaxation, p below 1e-7."""
    problem = problem_of(RIG, [prepare(chain(first_hz, seed, share), RIG)])
    judge = BlockJudge.of(problem, variants(catalogue()))
    assert screened_baseline(judge).screening.p_value > 1e-3


@pytest.mark.parametrize(("share", "found"), [(0.1, 0.1), (0.2, 0.0)])
def test_much_noise_of_an_input_counts_where_half_of_its_spectrum_has_nothing_else(share: float, found: float) -> None:
    """Up to `MOST_BEYOND_A_BAND`; beyond it an input is taken as it is."""
    recorded = prepare(chain(120.0, 31, share), RIG)
    assert rms_of_inputs(RIG, recorded)[0] / np.std(recorded.inputs[0]) == pytest.approx(found, abs=0.02)


def test_noise_that_drives_is_none_of_the_input() -> None:
    recording = chain(120.0, 31, 0.0)
    recording.data[0] = np.random.default_rng(3).normal(size=recording.data.shape[1])
    assert rms_of_inputs(RIG, prepare(recording, RIG))[0] == 0.0
