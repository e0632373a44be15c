"""The recorder's noise: what whitens it, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.mismatch.ring_downs.noise import noise_models


def test_whitened_noise_is_white_with_unit_variance() -> None:
    rng = np.random.default_rng(3)
    rate, pole = 25000.0, math.exp(-2 * math.pi * 300 / 25000)
    quiet, whole, recorded = [], [], []
    for _ in range(48):
        slow = np.zeros((2, 3000))
        step = 0.1 * rng.standard_normal((2, 3000))
        for i in range(1, 3000):
            slow[:, i] = pole * slow[:, i - 1] + step[:, i]
        y = 0.01 * (slow + rng.standard_normal((2, 3000)))[:, 500:]
        quiet.append(y[:, :245])
        whole.append(y[0] - y[1])
        recorded.append(y)
    models = noise_models(quiet, whole, rate)
    white = np.stack([models[0].whiten(y[0])[200:] for y in recorded])
    spectrum = (np.abs(np.fft.rfft(white, axis=1)) ** 2).mean(axis=0) / white.shape[1]
    assert spectrum[2:40].mean() == pytest.approx(1, abs=0.1)
    assert spectrum[400:].mean() == pytest.approx(1, abs=0.03)


def test_noise_below_the_recorders_step_is_told() -> None:
    rng = np.random.default_rng(1)
    step = 1e-3
    quiet = [np.round(0.1 * step * rng.standard_normal((2, 240)) / step) * step for _ in range(8)]
    with pytest.raises(ValueError, match=r"smaller than the recorder's step of 0\.001"):
        noise_models(quiet, [q[0] - q[1] for q in quiet], 25e3, step)
