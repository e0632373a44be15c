"""Noise is white after whitening from the first sample on, and p-values of decays in slow noise are no smaller."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.noise import AUTOREGRESSION, Whitening
from analysis.mismatch.recordings.recorded import prepare
from mesotap.commands.diagnose import known_mechanisms
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import variants
from tests.analysis.mismatch.recordings.described_rigs import recorded

Real = NDArray[np.float64]

SAMPLES = 20_000
RUN_IN = 500  # samples, after which the noise is stationary


def ar1(size: tuple[int, int], pole: float, seed: int) -> Real:
    noise = np.random.default_rng(seed).standard_normal((size[0], size[1] + RUN_IN))
    return np.asarray(lfilter([1.0], [1.0, -pole], noise, axis=1)[:, RUN_IN:], np.float64)


@pytest.mark.parametrize("pole", [0.0, 0.9, 0.98, -0.8])
def test_the_first_sample_of_noise_weighs_as_what_it_is(pole: float) -> None:
    row = ar1((1, SAMPLES), pole, 1)
    whitening = Whitening.of(row, np.ones(SAMPLES, bool))
    one = np.zeros((1, 40))
    one[0, 0] = 1.0
    # of first-order noise its standard deviation is 1 / sqrt(1 - pole^2) of what cannot be predicted
    assert whitening(one)[0, 0] == pytest.approx(np.sqrt(1 - pole**2), rel=0.1)
    assert whitening(one)[0, 1] == pytest.approx(-pole, abs=0.05)


def test_noise_of_two_channels_is_white_from_the_first_sample_on() -> None:
    moved, pulled = np.array([[0.9, 0.1], [-0.2, 0.7]]), np.array([[1.0, 0.0], [0.5, 2.0]])

    def noise(samples: int, seed: int) -> Real:
        driven = pulled @ np.random.default_rng(seed).standard_normal((2, samples + RUN_IN))
        y = np.zeros(driven.shape)
        for t in range(1, y.shape[1]):
            y[:, t] = moved @ y[:, t - 1] + driven[:, t]
        return y[:, RUN_IN:]

    whitening = Whitening.of(noise(SAMPLES, 0), np.ones(SAMPLES, bool))
    white = np.array([whitening(noise(AUTOREGRESSION + 4, seed)) for seed in range(1, 1501)]).reshape(1500, -1)
    # 4 standard errors of 1500 draws, and of 20 000 samples that it was fitted to
    np.testing.assert_allclose(np.var(white, axis=0), 1.0, atol=0.17)
    assert np.abs(np.corrcoef(white.T) - np.eye(white.shape[1])).max() < 0.13


def test_a_row_shorter_than_the_autoregression_is_whitened_as_the_beginning_of_a_longer_one() -> None:
    rows = ar1((1, SAMPLES), 0.9, 2)
    whitening = Whitening.of(rows, np.ones(SAMPLES, bool))
    np.testing.assert_allclose(whitening(rows[:, :5]), whitening(rows)[:, :5], rtol=1e-9)


@pytest.mark.slow
def test_p_values_of_decays_in_slow_noise_are_not_too_small() -> None:
    rig = parse_rig(
        "bodies: {mass: 0.35}\n"
        "springs: [{between: [mass, ground], stiffness: unknown, damping: unknown}]\n"
        "sensors: [{channel: 0, of: mass, shows: displacement}]\n"
    )
    at_the_beginning = {"attached_mass", "frame_compliance", "double_hit"}
    rate, known = 625.0, [m for m in variants(known_mechanisms()) if m.id in at_the_beginning]
    t = np.arange(2500) / rate
    decay = 1e-3 * np.exp(-0.75 * t) * np.cos(2 * np.pi * 20 * t)
    noise = 2e-6 * ar1((24, t.size), 0.97, 3)
    found = []
    for row in noise:
        judge = BlockJudge.of(problem_of(rig, [prepare(recorded([decay + row], rate, 0.0), rig)]), known)
        found.append(judge.screen(judge.baseline()).p_value)
    # more than 2 of 24 uniform ones are below 0.01 with a probability of 0.002
    assert np.count_nonzero(np.array(found) < 0.01) <= 2, found
