"""ERA, the tester's modes and other ring-downs against exact two-mass responses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.modal.era import hankel, realise
from analysis.modal.exponentials import FitFailure
from analysis.modal.identify import identify_ring_down
from analysis.modal.modes import sampled_pole
from analysis.modal.noise import NoiseModel, noise_model
from analysis.modal.tester import filter_poles, identify_impacts
from daq.records import RigDescription

RATE = 25000.0
# system and contact mode of the published range: f1, f2 in Hz, zeta2
PUBLISHED = [
    (356, 2234, 0.0016),
    (356, 1925, 0.0016),
    (356, 1855, 0.005),
    (356, 1410, 0.028),
    (281, 955, 0.03),
    (281, 733, 0.08),
    (281, 598, 0.17),
]


def pair(f1, f2, zeta2, zeta1=0.002):
    return np.array([sampled_pole(f1, zeta1, RATE), sampled_pole(f2, zeta2, RATE)])


def ringing(z, samples, amplitudes=(0.25, 0.5)):
    c = np.array(amplitudes) * np.exp(1j * np.linspace(0.3, 2.5, z.size))
    return 2 * (c[:, None] * z[:, None] ** np.arange(samples)).real.sum(axis=0)


def frequency_and_damping(z):
    s = np.log(z) * RATE
    return np.abs(s) / (2 * np.pi), -s.real / np.abs(s)


@pytest.mark.parametrize(("f1", "f2", "zeta2"), PUBLISHED)
def test_era_is_exact_on_clean_data(f1, f2, zeta2):
    z = pair(f1, f2, zeta2)
    realised = realise(hankel(ringing(z, 4000)), 4)
    f, zeta = frequency_and_damping(realised.poles)
    assert f == pytest.approx([f1, f2], rel=1e-7)
    assert zeta == pytest.approx([0.002, zeta2], rel=1e-5)
    assert realised.emac == pytest.approx([1.0, 1.0], abs=1e-5)


@pytest.mark.parametrize(("f1", "f2", "zeta2"), PUBLISHED)
def test_era_covers_at_40_decibels(f1, f2, zeta2):
    rng = np.random.default_rng(2)
    z = pair(f1, f2, zeta2)
    y = ringing(z, 4000)
    sigma = 0.01 * np.abs(y).max()
    scores, frequencies = [], []
    for _ in range(40):
        realised = realise(hankel(y + sigma * rng.normal(size=y.size)), 4, sigma**2)
        assert realised.poles.size == 2
        error = np.log(realised.poles) - np.log(z)
        spread = realised.log_pole_covariance
        scores += [error.real / np.sqrt(spread[:, 0, 0]), error.imag / np.sqrt(spread[:, 1, 1])]
        frequencies.append(frequency_and_damping(realised.poles)[0][1])
    assert 0.85 < np.std(scores) < 1.15
    assert np.mean(frequencies) == pytest.approx(f2, rel=2e-3)


def test_era_of_several_channels_finds_shapes():
    z = pair(356, 1410, 0.02)
    first, second = ringing(z[:1], 3000, (0.4,)), ringing(z[1:], 3000, (0.3,))
    realised = realise(hankel(np.stack([first + second, first - second])), 4)
    ratio = realised.shapes[1] / realised.shapes[0]
    assert ratio == pytest.approx([1.0, -1.0], abs=1e-8)
    assert realised.mpc == pytest.approx([1.0, 1.0], abs=1e-8)


def test_hankel_products_are_those_of_the_matrix():
    y = np.random.default_rng(0).normal(size=(2, 60))
    decomposed = hankel(y, lags=5)
    h0 = np.stack([y[a, i : i + 55] for i in range(5) for a in range(2)])
    h1 = np.stack([y[a, i + 1 : i + 56] for i in range(5) for a in range(2)])
    assert decomposed.shifted == pytest.approx(h1 @ h0.T, abs=1e-10)
    assert decomposed.singular_values == pytest.approx(np.linalg.svd(h0, compute_uv=False), rel=1e-6)


def test_an_empty_record_and_a_short_one_say_so():
    with pytest.raises(FitFailure, match="zeros"):
        hankel(np.zeros(500))
    with pytest.raises(FitFailure, match="too few"):
        hankel(np.ones(9))


# --- noise -----------------------------------------------------------------------------------------------


def test_colour_of_the_noise_is_found_and_undone():
    rng = np.random.default_rng(4)
    white = rng.normal(size=40_000)
    coloured = np.zeros_like(white)
    for k in range(2, white.size):
        coloured[k] = 1.2 * coloured[k - 1] - 0.5 * coloured[k - 2] + white[k]
    model = noise_model(np.split(coloured, 100))
    assert model.coefficients[:3] == pytest.approx([1.0, -1.2, 0.5], abs=0.03)
    assert model.variance == pytest.approx(1.0, abs=0.03)
    rest = model.whiten(coloured)
    lagged = [np.corrcoef(rest[:-lag], rest[lag:])[0, 1] for lag in range(1, 6)]
    assert np.abs(lagged).max() < 0.02


def test_white_noise_is_left_alone():
    rng = np.random.default_rng(4)
    orders = [noise_model(np.split(rng.normal(size=8000), 32)).order for _ in range(20)]
    assert np.mean(np.array(orders) > 0) <= 0.2


# --- the tester ------------------------------------------------------------------------------------------


def description(f1, highpass=math.nan):
    k = 0.215 / 2 * (2 * math.pi * f1) ** 2
    family = "none" if math.isnan(highpass) else "butterworth"
    return RigDescription(0.107, 0.108, k, k, RATE, highpass, 1, 10000.0, 4, family, 50.0, 16)


def taps(z, count, sigma, rng, samples=4000, quiet=250, pulse=8):
    """Records that begin with noise, then a smooth onset (the pulse), then the free decay."""
    records = []
    for _ in range(count):
        free = ringing(z, samples, rng.uniform(0.2, 0.6, 2))
        onset = np.sin(np.linspace(0, np.pi / 2, pulse)) ** 2
        free[:pulse] *= onset
        records.append(np.concatenate([np.zeros(quiet), free]) + sigma * rng.normal(size=samples + quiet))
    return records, [quiet] * count


@pytest.mark.parametrize("method", ["ml", "era"])
@pytest.mark.parametrize(("f1", "f2", "zeta2"), PUBLISHED)
def test_both_modes_of_every_impact_at_40_decibels(f1, f2, zeta2, method):
    rng = np.random.default_rng(8)
    z = pair(f1, f2, zeta2)
    records, quiet = taps(z, 8, 0.01, rng)
    found = identify_impacts(records, quiet, RATE, description(f1), NoiseModel(np.ones(1), 1e-4), method)
    f = [m.contact.frequency_hz for m in found]
    damping = [m.contact.damping_ratio for m in found]
    for estimates, true in ((f, f2), (damping, zeta2)):
        score = np.array([(e.value - true) / e.standard_error for e in estimates])
        assert np.abs(score).max() < 4.5
    assert np.mean([e.value for e in f]) == pytest.approx(f2, rel=3e-3)
    assert [m.system.frequency_hz.value for m in found] == pytest.approx([f1] * 8, rel=1e-4)


def test_the_fit_begins_where_the_pulse_has_ended():
    rng = np.random.default_rng(9)
    records, quiet = taps(pair(356, 1410, 0.03), 8, 0.002, rng, pulse=20)
    found = identify_impacts(records, quiet, RATE, description(356), NoiseModel(np.ones(1), 4e-6))
    starts = np.array([m.start for m in found]) - 250
    assert (starts >= 17).all()  # the last samples of the onset hide in the noise
    assert np.median(starts) < 30


def test_the_filters_slow_pole_is_part_of_the_model():
    assert filter_poles(description(356, 10.0), RATE) == pytest.approx([np.exp(-2 * np.pi * 10 / RATE)])
    assert filter_poles(description(356), RATE) == pytest.approx([1.0])


def test_noise_alone_gives_a_reason_and_no_modes():
    rng = np.random.default_rng(1)
    records = [0.01 * rng.normal(size=3000) for _ in range(3)]
    found = identify_impacts(records, [250] * 3, RATE, description(356), NoiseModel(np.ones(1), 1e-4))
    for modes in found:
        assert modes.contact is None or modes.contact.damping_ratio.standard_error > 0.1 * abs(
            modes.contact.damping_ratio.value
        )
        assert modes.contact is not None or modes.notes


# --- any other ring-down ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["ml", "era"])
def test_modes_of_an_unknown_structure(method):
    rng = np.random.default_rng(7)
    f, zeta = np.array([80.0, 297.0, 420.0, 1527.0]), np.array([0.004, 0.002, 0.01, 0.0015])
    z = np.array([sampled_pole(a, b, 12800.0) for a, b in zip(f, zeta, strict=True)])
    shapes = rng.normal(size=(3, 4))
    y = 2 * ((shapes * np.exp(1j)) @ (z[:, None] ** np.arange(16000))).real
    y += 0.001 * np.abs(y).max() * rng.normal(size=y.shape)
    found = identify_ring_down(np.concatenate([np.zeros((3, 50)), y], axis=1), 12800.0, method=method)
    assert [m.frequency_hz.value for m in found.modes] == pytest.approx(f, rel=1e-3)
    assert [m.damping_ratio.value for m in found.modes] == pytest.approx(zeta, rel=0.05)


def test_noise_has_no_modes():
    found = identify_ring_down(np.random.default_rng(0).normal(size=(2, 8000)), 1000.0)
    assert len(found.modes) <= 1
