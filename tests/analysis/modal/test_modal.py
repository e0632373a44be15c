"""ERA, the tester's modes and other ring-downs against exact two-mass responses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.modal.era import hankel_svd, realise
from analysis.modal.exponentials import FitFailure, fit_exponentials
from analysis.modal.identify import identify_ring_down
from analysis.modal.modes import sampled_pole
from analysis.modal.noise import NoiseModel, noise_model
from analysis.modal.pulse_end import innovations, samples_before
from analysis.modal.tester import filter_poles, identify_impacts
from analysis.stiffness import contact_from_pole, pole
from daq.records import RigDescription
from sim_backend.pulses import half_sine
from sim_backend.ring_down import ring_down_linear
from sim_backend.two_mass import TwoMass

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
    realised = realise(hankel_svd(ringing(z, 4000)), 4)
    f, zeta = frequency_and_damping(realised.poles)
    assert f == pytest.approx([f1, f2], rel=1e-7)
    assert zeta == pytest.approx([0.002, zeta2], rel=1e-5)
    assert realised.emac == pytest.approx([1.0, 1.0], abs=1e-5)


@pytest.mark.parametrize("decibel", [20, 40])
@pytest.mark.parametrize(("f1", "f2", "zeta2"), PUBLISHED)
def test_era_covers(f1, f2, zeta2, decibel):
    rng = np.random.default_rng(2)
    z = pair(f1, f2, zeta2)
    y = ringing(z, 4000)
    sigma = 10 ** (-decibel / 20) * np.abs(y).max()
    scores, frequencies = [], []
    for _ in range(40):
        realised = realise(hankel_svd(y + sigma * rng.normal(size=y.size), 100), 4, sigma**2)
        assert realised.poles.size == 2
        error = np.log(realised.poles) - np.log(z)
        spread = realised.log_pole_covariance
        scores += [error.real / np.sqrt(spread[:, 0, 0]), error.imag / np.sqrt(spread[:, 1, 1])]
        frequencies.append(frequency_and_damping(realised.poles)[0][1])
    # without the noise taken off, decay is read 3 to 5 standard errors too fast at 20 dB
    assert np.abs(np.mean(scores)) < 0.35
    assert 0.8 < np.std(scores) < 1.25
    assert np.mean(frequencies) == pytest.approx(f2, rel=5e-3)


def test_lags_may_be_samples_apart():
    z = pair(281, 733, 0.08)
    realised = realise(hankel_svd(ringing(z, 3000), 20, spacing=4), 4)
    assert np.log(realised.poles) == pytest.approx(np.log(z), abs=1e-8)
    y = np.random.default_rng(0).normal(size=(2, 60))
    decomposed = hankel_svd(y, lags=5, spacing=3)
    h0, h1 = (np.stack([y[a, 3 * i + b : 3 * i + b + 45] for i in range(5) for a in range(2)]) for b in (0, 3))
    assert decomposed.shifted == pytest.approx(h1 @ h0.T, abs=1e-10)
    assert decomposed.singular_values == pytest.approx(np.linalg.svd(h0, compute_uv=False), rel=1e-6)


def test_era_of_several_channels_finds_shapes():
    z = pair(356, 1410, 0.02)
    first, second = ringing(z[:1], 3000, (0.4,)), ringing(z[1:], 3000, (0.3,))
    realised = realise(hankel_svd(np.stack([first + second, first - second])), 4)
    ratio = realised.shapes[1] / realised.shapes[0]
    assert ratio == pytest.approx([1.0, -1.0], abs=1e-8)
    assert realised.mpc == pytest.approx([1.0, 1.0], abs=1e-8)


def test_hankel_products_are_those_of_the_matrix():
    y = np.random.default_rng(0).normal(size=(2, 60))
    decomposed = hankel_svd(y, lags=5)
    h0 = np.stack([y[a, i : i + 55] for i in range(5) for a in range(2)])
    h1 = np.stack([y[a, i + 1 : i + 56] for i in range(5) for a in range(2)])
    assert decomposed.shifted == pytest.approx(h1 @ h0.T, abs=1e-10)
    assert decomposed.singular_values == pytest.approx(np.linalg.svd(h0, compute_uv=False), rel=1e-6)


def test_an_empty_record_and_a_short_one_say_so():
    with pytest.raises(FitFailure, match="zeros"):
        hankel_svd(np.zeros(500))
    with pytest.raises(FitFailure, match="too few"):
        hankel_svd(np.ones(9))


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


def taps(z, count, sigma, rng, samples=4000, quiet=250, pulse=8, amplitudes=None):
    """Records that begin with noise, then a smooth onset (the pulse), then the free decay."""
    records = []
    for _ in range(count):
        free = ringing(z, samples, rng.uniform(0.2, 0.6, 2) if amplitudes is None else amplitudes)
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


def test_innovations_of_a_free_decay_are_unit_white_noise():
    rng = np.random.default_rng(3)
    z, nothing = pair(281, 955, 0.17), np.zeros(0, complex)
    scores = []
    for _ in range(150):
        y = ringing(z, 1500) + 0.01 * rng.normal(size=1500)

        def refit(y, start, poles):
            return fit_exponentials(y[start:], poles)

        scores.append(innovations(y, 0, 30, fit_exponentials(y[30:], z), nothing, 1e-4))
    scores = np.array(scores)
    assert scores.shape == (150, 29)  # the sample of the trigger itself is left
    assert scores.std(axis=0) == pytest.approx(np.ones(29), abs=0.3)
    assert np.std(scores) == pytest.approx(1.0, abs=0.05)
    correlated = scores.T @ scores / 150 - np.eye(29)
    assert np.abs(correlated[~np.eye(29, dtype=bool)]).mean() < 0.09  # by chance 0.065


def test_all_taps_together_show_what_one_alone_hides():
    rng = np.random.default_rng(4)
    tail = np.concatenate([np.zeros(20), [0.7, 2.0, 3.0, 9.0]])  # the pulse, coming from after it
    together, single = [], []
    for _ in range(200):
        scores = [tail + rng.normal(size=tail.size) for _ in range(8)]
        together.append(samples_before(scores, 30)[0])
        single.append(samples_before(scores[:1], 30)[0])
    assert np.mean(np.array(together) > 20) < 0.01
    assert np.mean(np.array(single) > 20) > 0.02
    assert np.median(together) >= 18
    assert samples_before([], 30) == []


def test_chance_does_not_begin_a_load_late():
    rng = np.random.default_rng(5)
    before = [samples_before(list(rng.normal(size=(8, 28))), 30)[0] for _ in range(300)]
    assert max(before) == 27
    assert np.mean(before) > 26
    assert min(before) > 15


def test_a_tap_with_a_longer_pulse_stands_for_itself():
    rng = np.random.default_rng(6)
    scores = [rng.normal(size=25) for _ in range(7)] + [np.append(rng.normal(size=9), 40.0)]
    for s in scores[:7]:
        s[-1] = 30.0
    before = samples_before(scores, 30)
    assert len(set(before[:7])) == 1
    assert before[0] > 18
    assert before[7] <= 9


def test_the_tail_of_a_pulse_is_no_free_decay():
    # a heavily damped mode: the force of the last samples of a half-sine moves it by a few standard deviations only
    rng = np.random.default_rng(7)
    f1, f2, zeta2 = 281.0, 955.0, 0.17
    k = 0.215 / 2 * (2 * np.pi * f1) ** 2
    stiffness, damping = contact_from_pole(pole(f2, zeta2), 0.107, 0.108, k, k)
    tester = TwoMass(0.107, 0.108, k, k, stiffness, damping)
    starts, scores = [], []
    for _ in range(10):
        records, ends = [], []
        for _ in range(8):
            onset = 250 + rng.uniform()
            clean = ring_down_linear(tester, half_sine(1.0, 0.3e-3), onset / RATE, 3000, RATE).acceleration
            sigma = 0.01 * np.abs(clean).max()
            records.append(clean + sigma * rng.normal(size=clean.size))
            ends.append(onset + 0.3e-3 * RATE)
        found = identify_impacts(records, [250] * 8, RATE, description(f1), NoiseModel(np.ones(1), sigma**2))
        starts += [m.start - end for m, end in zip(found, ends, strict=True)]
        scores += [(m.contact.frequency_hz.value - f2) / m.contact.frequency_hz.standard_error for m in found]
        scores += [(m.contact.damping_ratio.value - zeta2) / m.contact.damping_ratio.standard_error for m in found]
    assert min(starts) > -1
    assert np.median(starts) < 4
    assert np.std(scores) < 1.15


def test_a_third_mode_does_not_hide_the_end_of_the_pulse():
    rng = np.random.default_rng(8)
    z = np.append(pair(356, 1410, 0.02), sampled_pole(3300, 0.004, RATE))
    records, quiet = taps(z, 8, 0.003, rng, amplitudes=(0.25, 0.4, 0.012))
    found = identify_impacts(records, quiet, RATE, description(356), NoiseModel(np.ones(1), 9e-6))
    assert any("further mode" in note for note in found[0].notes)
    starts = np.array([m.start for m in found]) - 250
    assert (starts >= 5).all()
    assert np.median(starts) < 14
    score = [(m.contact.frequency_hz.value - 1410) / m.contact.frequency_hz.standard_error for m in found]
    assert np.abs(score).max() < 4.5


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
