"""Errors on held-out blocks against noise, on decays that are sums of exponentials."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter
from scipy.stats import kstest

from analysis.mismatch.recordings.fit import SimulatedRecordings, fit
from analysis.mismatch.recordings.held_out import HeldOutErrors, _among, beyond_noise, held_out_errors
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, prepare
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig

Real = NDArray[np.float64]
RATE, SAMPLES = 1000.0, 1200
MASS = np.array([0.5, 0.3])
STIFFNESS = np.array([[9e4, -3e4], [-3e4, 3e4]])
DAMPING = np.array([[1.7, -0.5], [-0.5, 0.5]])
RIG = parse_rig("""
bodies: {one: 0.5, two: 0.3}
joints: [{name: lower, between: [one, ground]}, {name: upper, between: [two, one]}]
sensors:
  - {channel: a, of: one, shows: displacement, unit: mm, offset: 0}
  - {channel: b, of: two, shows: displacement, unit: um, gain: 1000, offset: 0}
recording: {from_s: 0}
""")
TRUTH = {
    "stiffness of lower": 6e4,
    "stiffness of upper": 3e4,
    "damping of lower": 1.2,
    "damping of upper": 0.5,
}
STARTED = np.array([0.0, 0.0, 1.0, -0.5])


@cache
def _step() -> Real:
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS / MASS[:, None], -DAMPING / MASS[:, None]]])
    return np.asarray(expm(a / RATE), np.float64)


def errors_of(seed: int, noise: float, pole: float = 0.0, jump: float = 0.0, at: int = 0) -> HeldOutErrors:
    """Return the errors of a decay whose upper body jumps in speed at a sample; the noise is a share of the rms."""
    states = [STARTED]
    for n in range(1, SAMPLES):
        states.append(_step() @ states[-1] + (np.array([0, 0, 0, jump]) if n == at else 0.0))
    shown = np.array(states)[:, :2].T * np.array([[1.0], [1000.0]])
    rows = np.random.default_rng(seed).normal(size=shown.shape)
    shown = shown + noise * shown.std(axis=1, keepdims=True) * lfilter([1.0], [1.0, -pole], rows, axis=1)
    recorded = prepare(Recording(shown, RATE, ("a", "b"), "", "made"), RIG)
    assert (recorded.every, recorded.fitted.start) == (1, 0)
    constants = {p.name: TRUTH.get(p.name, p.value) for p in RIG.arrangement.parameters}
    problem = SimulatedRecordings(RIG, (recorded,), constants, 80.0, (STARTED,))
    return held_out_errors(fit(problem, parts=(FIT, CHOOSE), fine=True))


@pytest.mark.slow
@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_noise_is_within_noise_as_often_as_it_should(pole: float) -> None:
    p_values = [errors_of(seed, 0.01, pole).p_value for seed in range(16)]
    assert kstest(p_values, "uniform").pvalue > 0.01


def test_an_impact_within_a_held_out_block_is_seen_in_that_block_alone() -> None:
    found = errors_of(3, 0.01, jump=0.05, at=380)  # of 24 blocks of 50 samples, the 8th from the first
    assert found.p_value < 1e-9
    first, last = found.worst().time_s
    assert first < 0.380 < last
    others = [b for b in found.blocks if b.time_s != (first, last)]
    assert min(b.p_value for b in others) > 1e-3


def test_what_is_beyond_noise_is_said_with_channel_and_time() -> None:
    found = errors_of(3, 0.01, jump=0.05, at=380)
    constants = {p.name: TRUTH.get(p.name, p.value) for p in RIG.arrangement.parameters}
    problem = SimulatedRecordings(RIG, (), constants, 80.0, ())
    assert "channel b from 0.35 to 0.399 s are" in beyond_noise(found, problem)
    assert beyond_noise(errors_of(3, 0.01), problem) == ""


def test_channels_of_different_units_are_told_apart() -> None:
    found = errors_of(3, 0.01, jump=0.05, at=380)
    assert found.ratio(1) > 1.2
    assert errors_of(3, 0.01).ratio(0) == pytest.approx(1.0, abs=0.15)


def test_p_values_among_draws_count_the_weights_of_the_whitening() -> None:
    """An autoregression fitted to what is compared makes it smaller there, and larger in what is held out."""
    random, size, order, length = np.random.default_rng(185), 1200, 40, 120
    used = np.arange(size) < size - length
    at = np.flatnonzero(~used)
    counted, alone = [], []
    for _ in range(250):
        noise = random.standard_normal(size + order)
        lags = np.column_stack([noise[order - k : order - k + size] for k in range(1, order + 1)])
        rows = noise[order:]
        weights = np.linalg.lstsq(lags[used], rows[used], rcond=None)[0]
        drawn = random.standard_normal((80, size))
        error = rows - lags @ weights
        counted.append(_among(drawn, error, used, at, order / np.count_nonzero(used))[1])
        alone.append(_among(drawn, error, used, at, 0.0)[1])
    assert kstest(counted, "uniform").pvalue > 0.05
    assert kstest(alone, "uniform").pvalue < 0.01  # the test can fail
