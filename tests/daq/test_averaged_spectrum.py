from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from daq.averaged_spectrum import AveragedSpectrum

RATE = 25_000.0


def test_white_noise_has_the_density_of_its_variance():
    sigma = 0.02
    spectrum = AveragedSpectrum(2, RATE, 1024, 200)
    spectrum.add(sigma * np.random.default_rng(3).standard_normal((2, 120_000)))
    inner = spectrum.amplitude_density()[:, 4:-4]
    assert np.sqrt(np.mean(inner**2, axis=1)) == pytest.approx(sigma / np.sqrt(RATE / 2), rel=0.01)


def test_a_sine_has_its_power_whatever_the_length_of_the_blocks():
    t = np.arange(60_000) / RATE
    sine = np.tile(0.3 * np.sin(2 * np.pi * 1234.0 * t), (2, 1))
    spectrum = AveragedSpectrum(2, RATE, 4096, 100)
    for block in np.split(sine, [1, 257, 4000, 4096, 30_000], axis=1):
        spectrum.add(block)
    power = np.sum(spectrum.amplitude_density() ** 2, axis=1) * RATE / 4096
    assert power == pytest.approx(0.3**2 / 2, rel=1e-3)
    _, welch = signal.welch(sine, RATE, "hann", 4096)
    assert spectrum.amplitude_density() == pytest.approx(np.sqrt(welch), rel=1e-9, abs=1e-12)


def test_the_average_is_over_the_last_segments_and_begins_anew():
    spectrum = AveragedSpectrum(1, RATE, 256, 4)
    assert np.isnan(spectrum.amplitude_density()).all()
    spectrum.add(np.random.default_rng(1).standard_normal((1, 2560)))
    assert spectrum.count == 4
    spectrum.add(np.zeros((1, 2560)))
    assert np.all(spectrum.amplitude_density() < 1e-15)  # the loud ones are forgotten
    spectrum.average_over(2)
    assert (spectrum.count, spectrum.averages) == (2, 2)
    spectrum.reset()
    assert spectrum.count == 0


def test_no_segment_spans_a_gap():
    spectrum = AveragedSpectrum(1, RATE, 256, 10)
    spectrum.add(np.zeros((1, 200)))
    spectrum.break_off()
    spectrum.add(np.ones((1, 200)))
    assert spectrum.count == 0
