"""Least squares with exponentials against direct sums, the noise-free truth, and the Cramer-Rao bound."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.modal.exponentials import (
    FitFailure,
    exponentials,
    fit_exponentials,
    predict,
)
from analysis.modal.modes import mode_from_sampled_pole, sampled_pole
from analysis.modal.sums import all_poles, data_sums, power_sums, record_sums, tail_of

RATE = 25000.0
PUBLISHED = [(356, 2234, 0.0016), (356, 1925, 0.005), (356, 1410, 0.028), (281, 955, 0.03), (281, 598, 0.17)]


def ring_down(f1, f2, zeta2, samples=4000, zeta1=0.002, amplitude=(0.5, 0.5)):
    z = np.array([sampled_pole(f1, zeta1, RATE), sampled_pole(f2, zeta2, RATE)])
    c = np.array(amplitude) * np.exp(1j * np.array([1.0, 2.0]))
    return z, 2 * (c[:, None] * z[:, None] ** np.arange(samples)).real.sum(axis=0)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 3000), st.floats(0.0, 1.0), st.floats(-3.14, 3.14))
def testpower_sums_are_those_of_the_powers(n, radius, angle):
    w = complex(radius * np.exp(1j * angle))
    k = np.arange(n, dtype=float)
    powers = np.array([w**i for i in range(n)]) if n < 50 else w**k
    direct = [powers.sum(), (k * powers).sum(), (k * k * powers).sum()]
    scale = [1.0 + np.abs(powers).sum(), 1.0 + (k * np.abs(powers)).sum(), 1.0 + (k * k * np.abs(powers)).sum()]
    for found, expected, size in zip(power_sums(w, n), direct, scale, strict=True):
        assert abs(found - expected) < 1e-9 * size


@pytest.mark.parametrize("n", [1, 3, 4, 5, 997])
def testdata_sums_are_those_of_the_data(n):
    y = np.random.default_rng(n).normal(size=n)
    z = 0.995 * np.exp(0.4j)
    k = np.arange(n)
    s0, s1 = data_sums(y, z)
    assert s0 == pytest.approx((y * z**k).sum(), abs=1e-10)
    assert s1 == pytest.approx((k * y * z**k).sum(), abs=1e-8)


@pytest.mark.parametrize(("f1", "f2", "zeta2"), PUBLISHED)
def test_exact_without_noise(f1, f2, zeta2):
    z, y = ring_down(f1, f2, zeta2)
    fit = fit_exponentials(y, z * np.exp([0.0002j, 0.002j - 0.0005]))
    assert np.log(fit.poles) == pytest.approx(np.log(z), abs=1e-8)


@pytest.mark.parametrize(("f1", "f2", "zeta2"), PUBLISHED)
def test_standard_errors_are_those_of_repeated_records(f1, f2, zeta2):
    rng = np.random.default_rng(5)
    z, y = ring_down(f1, f2, zeta2)
    known = np.array([np.exp(-2 * np.pi * 10 / RATE)], np.complex128)
    scores = []
    for _ in range(150):
        noisy = y + 0.01 * rng.normal(size=y.size)
        fit = fit_exponentials(noisy, z, known)
        for i in range(2):
            mode = mode_from_sampled_pole(complex(fit.poles[i]), fit.log_pole_covariance[i], fit.amplitudes[:, i], RATE)
            true = abs(np.log(z[i])) * RATE / (2 * np.pi), -np.log(z[i]).real / abs(np.log(z[i]))
            for estimate, value in zip((mode.frequency_hz, mode.damping_ratio), true, strict=True):
                scores.append((estimate.value - value) / estimate.standard_error)
    scores = np.array(scores)
    assert 0.92 < scores.std() < 1.08
    assert 0.92 < (np.abs(scores) < 1.96).mean() < 0.98


def test_two_channels_share_poles_and_weigh_their_noise():
    rng = np.random.default_rng(3)
    z, y = ring_down(356, 1410, 0.02)
    both = np.stack([y, 0.1 * y]) + rng.normal(size=(2, y.size)) * np.array([[0.01], [0.5]])
    alone = fit_exponentials(both[0], z)
    together = fit_exponentials(both, z, noise_variance=np.array([1e-4, 0.25]))
    assert np.log(together.poles) == pytest.approx(np.log(z), abs=2e-5)
    assert together.log_pole_covariance[1, 0, 0] == pytest.approx(alone.log_pole_covariance[1, 0, 0], rel=0.1)


def test_known_poles_take_their_part_of_the_record():
    z, y = ring_down(356, 1410, 0.02)
    known = np.array([0.997 + 0j])
    record = y + 0.3 * known[0].real ** np.arange(y.size)
    fit = fit_exponentials(record, z, known)
    assert fit.fixed_amplitudes[0, 0] == pytest.approx(0.3, abs=1e-9)
    assert exponentials(fit, np.arange(y.size), known)[0] == pytest.approx(record, abs=1e-9)


def test_foretold_samples_scatter_as_their_covariance_says():
    rng = np.random.default_rng(11)
    z, y = ring_down(281, 733, 0.09, samples=1500)
    before = -np.arange(1, 9)
    truth = 2 * (0.5 * np.exp(1j * np.array([1.0, 2.0]))[:, None] * z[:, None] ** before).real.sum(axis=0)
    squares = []
    for _ in range(200):
        fit = fit_exponentials(y + 0.01 * rng.normal(size=y.size), z)
        values, covariance = predict(fit, before, y.size)
        squares.append((values - truth) ** 2 / (1e-4 * np.diagonal(covariance)))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.25)


def test_too_short_a_record_says_so():
    with pytest.raises(FitFailure, match="too few"):
        fit_exponentials(np.ones(10), np.array([0.9 + 0.1j, 0.8 + 0.3j]))


def test_a_tail_stands_for_the_samples_that_it_was_made_of():
    rng = np.random.default_rng(4)
    z, y = ring_down(281, 733, 0.09)
    known, moved = np.array([np.exp(-0.0025) + 0j]), z * np.exp([2e-7j, 3e-4 - 2e-4j])
    record = (y + 0.02 * rng.normal(size=y.size))[None]
    every = all_poles(moved, known)
    k = np.arange(y.size)
    tail = tail_of(record[:, 30:], z, known, 4e-4)
    reached, s0, s1 = record_sums(record[:, :30], tail, every, 4)
    assert reached
    direct = np.array([(record[0] * w.conj() ** k).sum() for w in every])
    slopes = np.array([(k * record[0] * w.conj() ** k).sum() for w in every[:4]])
    deviation = 0.02 * np.sqrt(np.array([(np.abs(w) ** (2 * k)).sum() for w in every]))
    assert np.abs(s0[0] - direct).max() < 1e-3 * deviation.min()
    assert np.abs(s1[0] - slopes).max() < 1e-3 * 0.02 * np.sqrt((k**2 * np.abs(every[1]) ** (2 * k)).sum())
    assert not record_sums(record[:, :30], tail, all_poles(z * np.exp([0.0, 0.1]), known), 4)[0]
