"""Free decays in a batch, further modes, the mode along its decay, and the spectrum as an independent check."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.modal.amplitude import along_the_decay, combined_curve, varies
from analysis.modal.exponentials import FitFailure, fit_exponentials
from analysis.modal.free_decay import identify_free_decays
from analysis.modal.further import Decay, with_further_modes
from analysis.modal.modes import sampled_pole
from analysis.modal.spectrum import spectral_mode

RATE = 25000.0
PUBLISHED = [
    (356, 2234, 0.0016),
    (356, 1925, 0.02),
    (356, 1410, 0.08),
    (281, 955, 0.03),
    (281, 733, 0.08),
    (281, 598, 0.17),
]
NOTHING = np.zeros(0, np.complex128)


def poles(*modes):
    return np.array([sampled_pole(f, zeta, RATE) for f, zeta in modes])


def decay(z, rng, samples=5000, amplitudes=None):
    a = np.full(z.size, 0.5) if amplitudes is None else np.asarray(amplitudes)
    c = a * np.exp(1j * rng.uniform(0, 2 * np.pi, z.size))
    return 2 * (c @ z[:, None] ** np.arange(samples)).real


# --- many at once ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("decibels", [20, 40, 60])
@pytest.mark.parametrize(("f1", "f2", "zeta2"), PUBLISHED)
def test_every_record_is_fitted_as_it_would_be_alone(f1, f2, zeta2, decibels):
    rng = np.random.default_rng(decibels)
    z = poles((f1, 0.002), (f2, zeta2))
    clean = np.stack([np.stack([decay(z, rng)] * 2) for _ in range(8)])
    noise = np.abs(clean).max(axis=(1, 2), keepdims=True) * 10 ** (-decibels / 20)
    y = clean + noise * rng.normal(size=clean.shape)
    found = identify_free_decays(y, RATE)
    for i in range(8):
        alone = fit_exponentials(y[i], z)
        error = np.sqrt(alone.log_pole_covariance[:, 0, 0])
        assert (np.abs(np.log(found.poles[i]) - np.log(alone.poles)) < 0.05 * error).all()
        assert found.log_pole_covariance[i] == pytest.approx(alone.log_pole_covariance, rel=0.02, abs=1e-14)
    score = (np.log(found.poles) - np.log(z)).imag / np.sqrt(found.log_pole_covariance[:, :, 1, 1])
    assert np.abs(score).max() < 4.5


def test_scatter_between_impacts_is_not_read_as_damping():
    rng = np.random.default_rng(0)
    true = 0.002
    ratio = []
    for _ in range(20):
        y = np.stack(
            [
                np.stack([decay(poles((356, 0.003), (1925 * (1 + 0.005 * rng.normal()), true)), rng)] * 2)
                for _ in range(8)
            ]
        )
        y += 0.002 * rng.normal(size=y.shape)
        damping = [m[1].damping_ratio.value for m in map(identify_free_decays(y, RATE).modes, range(8))]
        ratio.append(np.mean(damping) / true)
    assert np.mean(ratio) == pytest.approx(1.0, abs=1e-3)


def test_one_record_and_what_is_no_record():
    rng = np.random.default_rng(1)
    y = decay(poles((356, 0.002), (1410, 0.01)), rng)[None]
    assert identify_free_decays(y, RATE).modes(0)[1].frequency_hz.value == pytest.approx(1410, rel=1e-9)
    with pytest.raises(FitFailure):
        identify_free_decays(np.zeros((2, 20)), RATE)
    with pytest.raises(FitFailure):
        identify_free_decays(np.zeros((1, 2, 4000)), RATE)


# --- further modes ---------------------------------------------------------------------------------------


def fitted(records, two):
    return [Decay(y, 0, fit_exponentials(y, two)) for y in records]


@pytest.mark.parametrize(("f3", "zeta3"), [(3300, 0.004), (700, 0.02), (5200, 0.01)])
def test_a_third_mode_that_is_there_is_found(f3, zeta3):
    rng = np.random.default_rng(5)
    z = poles((356, 0.002), (1410, 0.01), (f3, zeta3))
    records = [decay(z, rng, 3000, [0.5, 0.5, 0.03]) + 0.005 * rng.normal(size=3000) for _ in range(8)]
    decays, added = with_further_modes(fitted(records, z[:2]), NOTHING)
    assert added.size == 1
    assert np.log(added[0]) == pytest.approx(np.log(z[2]), abs=0.05 * abs(np.log(z[2])) * max(zeta3 * 5, 0.02))
    for d in decays:
        score = (np.log(d.fit.poles[:2]) - np.log(z[:2])).imag / np.sqrt(d.fit.log_pole_covariance[:2, 1, 1])
        assert np.abs(score).max() < 4.5


def test_a_third_and_a_fourth_mode():
    rng = np.random.default_rng(6)
    z = poles((356, 0.002), (1410, 0.01), (2600, 0.004), (4100, 0.006))
    records = [decay(z, rng, 3000, [0.5, 0.5, 0.05, 0.05]) + 0.005 * rng.normal(size=3000) for _ in range(8)]
    _, added = with_further_modes(fitted(records, z[:2]), NOTHING)
    assert sorted(np.angle(added)) == pytest.approx(sorted(np.angle(z[2:])), rel=1e-3)


def test_none_is_added_that_is_not_there():
    rng = np.random.default_rng(7)
    z = poles((356, 0.002), (1410, 0.02))
    for _ in range(25):
        records = [decay(z, rng, 2500) + 0.01 * rng.normal(size=2500) for _ in range(8)]
        _, added = with_further_modes(fitted(records, z), NOTHING)
        assert added.size == 0


# --- along the decay -------------------------------------------------------------------------------------


def test_a_linear_mode_does_not_change_along_its_decay():
    rng = np.random.default_rng(8)
    z = poles((356, 0.002), (1410, 0.01))
    p_values = []
    for _ in range(60):
        curves = [along_the_decay(decay(z, rng, 4000) + 0.01 * rng.normal(size=4000), RATE, z, 1) for _ in range(4)]
        p_values += varies(curves)
    assert np.mean(np.array(p_values) < 0.05) < 0.12
    assert np.min(p_values) > 1e-4


def test_frequency_and_damping_that_fall_with_amplitude_are_followed():
    # an oscillator whose frequency and damping follow its amplitude slowly: A' = -zeta(A) w A
    rng = np.random.default_rng(9)
    samples, rate = 60_000, 12_800.0
    amplitude, phase = np.empty(samples), np.empty(samples)
    a, theta = 20.0, 0.3
    for k in range(samples):
        amplitude[k], phase[k] = a, theta
        omega = 2 * np.pi * (80.6 - 0.01 * a)
        a *= np.exp(-(0.0013 + 5e-5 * a) * omega / rate)
        theta += omega / rate
    y = amplitude * np.cos(phase) + 0.002 * rng.normal(size=samples)
    start = fit_exponentials(y, np.array([np.exp((-0.0018 + 1j) * 2 * np.pi * 80.45 / rate)])).poles
    points = along_the_decay(y, rate, start, 0)
    assert len(points) >= 6
    for p in points:
        assert p.frequency_hz.value == pytest.approx(80.6 - 0.01 * p.amplitude, abs=0.02)
        assert p.damping_ratio.value == pytest.approx(0.0013 + 5e-5 * p.amplitude, rel=0.08)
    assert max(varies([points])) < 1e-6
    joined = combined_curve([points, points])
    assert [p.amplitude for p in joined] == sorted((p.amplitude for p in joined), reverse=True)


# --- the spectrum ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("f1", "f2", "zeta2"), PUBLISHED[:5])
def test_the_spectrum_agrees_with_the_truth(f1, f2, zeta2):
    rng = np.random.default_rng(10)
    z = poles((f1, 0.002), (f2, zeta2))
    records = [decay(z, rng, 4700) + 0.01 * rng.normal(size=4700) for _ in range(8)]
    found = spectral_mode(records, RATE, 1.25 * f1, 10_000.0)
    assert found.frequency_hz.value == pytest.approx(f2, rel=3e-3)
    assert found.damping_ratio.value == pytest.approx(zeta2, rel=0.06)


def test_no_peak_no_answer():
    rng = np.random.default_rng(11)
    assert spectral_mode([rng.normal(size=30)] * 8, RATE, 400.0, 9000.0) is None
    assert spectral_mode([rng.normal(size=3000)] * 2, RATE, 400.0, 9000.0) is None
