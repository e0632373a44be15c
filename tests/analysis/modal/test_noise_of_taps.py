"""The colour of the noise from what a tap's modes leave, where hardly any noise was heard before it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from analysis.modal.modes import mode_from_sampled_pole, sampled_pole
from analysis.modal.noise import noise_model
from analysis.modal.noise_of_taps import left_over, noise_with_residuals
from analysis.modal.tester import ImpactModes

RATE, QUIET, SAMPLES = 25_000.0, 242, 5000
KNOWN = np.array([np.exp(-2 * np.pi * 10 / RATE)], complex)
COLOUR = (0.2, [1.0, -0.9])  # louder at 356 Hz than on the whole


def coloured(rng, samples):
    return signal.lfilter([COLOUR[0]], COLOUR[1], rng.standard_normal(samples + 500))[500:]


def tap(rng):
    """A record of two modes, and what is identified in it."""
    poles = [sampled_pole(356.0, 0.0005, RATE), sampled_pole(2000.0, 0.01, RATE)]
    clean = (np.array([10.0, 8.0 + 3j]) @ np.array(poles)[:, None] ** np.arange(SAMPLES)).real
    modes = [mode_from_sampled_pole(z, np.eye(2), np.ones(1, complex), RATE) for z in poles]
    return clean + coloured(rng, SAMPLES), ImpactModes(*modes, start=0, residual_ratio=1.0)


def loudness(model, frequency_hz):
    """Spectral density of the noise at a frequency."""
    return model.variance / abs(np.polyval(model.coefficients[::-1], np.exp(-2j * np.pi * frequency_hz / RATE))) ** 2


def test_what_the_modes_leave_tells_the_colour_that_a_few_samples_do_not():
    rng = np.random.default_rng(5)
    true = COLOUR[0] ** 2 / abs(1 - 0.9 * np.exp(-2j * np.pi * 356 / RATE)) ** 2
    alone, together = [], []
    for _ in range(30):
        quiet, (record, modes) = coloured(rng, QUIET), tap(rng)
        alone.append(loudness(noise_model([quiet]), 356.0) / true)
        together.append(loudness(noise_with_residuals([quiet], [record], [modes], KNOWN, RATE), 356.0) / true)
    assert np.std(together) < 0.15 < np.std(alone)
    assert np.mean(together) == pytest.approx(1.0, abs=0.1)


def test_what_holds_more_than_noise_tells_nothing_of_it():
    record, modes = tap(np.random.default_rng(6))
    assert left_over(record, modes, KNOWN, RATE).std() == pytest.approx(COLOUR[0] / np.sqrt(1 - 0.9**2), rel=0.1)
    assert left_over(record, replace(modes, residual_ratio=3.0), KNOWN, RATE) is None
    assert left_over(record, replace(modes, contact=None), KNOWN, RATE) is None
