"""How B follows A, on signals in closed form: unbiased, and the intervals cover as often as they say."""

from __future__ import annotations

import numpy as np
import pytest

from daq.channel_relation import relate
from tests.daq.taps_of_two import RATE, TRIGGER, motion, noise

BEFORE, AFTER = 250, 2500
SEEDS = 40
LEAST_COVERED = 33  # of 40 at 95 %: fewer come once in a thousand runs
CASES = {"equal": (1.0, 0.0), "opposite, weaker": (-0.8, 0.3), "a tenth, late": (0.1, 2.0)}


def related(a, b, seed, rms=0.001):
    record = np.stack([a, b]) + noise(np.random.default_rng(seed), rms)
    begin = TRIGGER - BEFORE
    return relate(record[:, begin : begin + BEFORE + AFTER], record[:, :begin], RATE)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("peak", [1.0, 0.1])
def test_intervals_of_gain_and_delay_cover(name, peak):
    gain, delay = CASES[name]
    a, b = motion(peak), gain * motion(peak, delay)
    found = [related(a, b, seed) for seed in range(SEEDS)]
    assert sum(abs(r.gain - gain) <= r.gain_half for r in found) >= LEAST_COVERED
    assert sum(abs(r.delay_samples - delay) <= r.delay_half for r in found) >= LEAST_COVERED
    assert np.mean([r.gain for r in found]) == pytest.approx(gain, rel=5e-3 / peak)
    spread = np.std([r.gain for r in found])
    assert np.mean([r.gain_half for r in found]) < 4 * spread  # nor are they so wide that they cover anything
    assert all(r.correlation * gain > 0 for r in found)
    assert min(r.sign_chi2 for r in found) > 100


def test_the_interval_of_the_correlation_covers():
    found = [related(motion(), motion(), seed) for seed in range(SEEDS)]
    assert sum(r.correlation_low <= 1.0 <= r.correlation_high for r in found) >= LEAST_COVERED
    assert min(r.correlation_low for r in found) > 0.9999


def test_a_motion_of_b_alone_lowers_the_correlation_by_its_energy():
    common, loose = motion(), motion(0.3, modes=((900.0, 0.01, 1.0),)) - motion(0.3, modes=())
    faded = np.ones(BEFORE + AFTER)
    faded[-550:] = 0.5 * (1 + np.cos(np.pi * np.arange(1, 551) / 550))
    window = slice(TRIGGER - BEFORE, TRIGGER + AFTER)
    a, b = faded * common[window], faded * (common + loose)[window]
    truth = a @ b / np.sqrt((a @ a) * (b @ b))
    found = related(common, common + loose, 7)
    assert found.correlation == pytest.approx(truth, abs=0.005)
    assert found.correlation_high < 0.99


def test_two_channels_of_noise_have_no_correlation():
    nothing = np.zeros_like(motion())
    found = related(nothing, nothing, 4)
    assert found.correlation_low < 0.9
    assert found.sign_chi2 < 100


def test_too_little_quiet_is_refused():
    with pytest.raises(ValueError, match="too few"):
        relate(np.zeros((2, 100)), np.zeros((2, 300)), RATE)
