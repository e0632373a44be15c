"""Intervals of faint modes: as wide as the likelihood, not as its curvature."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.modal.exponentials import fit_exponentials
from analysis.modal.likelihood_interval import energies, widened, widening
from analysis.modal.modes import mode_from_sampled_pole, sampled_pole

RATE = 25_000.0
NONE = np.zeros(0, np.complex128)


def record(rng, sigma, zeta=0.02, samples=2000, channels=1):
    z = sampled_pole(733.0, zeta, RATE)
    y = (np.exp(0.7j) * z ** np.arange(samples)).real * np.ones((channels, 1))
    return z, y + sigma * rng.standard_normal((channels, samples))


def test_energy_is_that_of_the_decay_over_its_noise():
    z, y = record(np.random.default_rng(1), 0.01)
    clean = (np.exp(0.7j) * z ** np.arange(2000)).real
    energy = energies(fit_exponentials(y, np.array([z])), 2000)[0]
    assert energy == pytest.approx((clean**2).sum() / 1e-4, rel=0.15)


def test_a_mode_that_stands_out_keeps_its_standard_errors():
    for channels in (1, 3):
        z, y = record(np.random.default_rng(2), 0.02, channels=channels)
        assert (widening(y, fit_exponentials(y, np.array([z])), NONE) == 1).all()


def test_faint_modes_are_covered_where_their_curvature_does_not():
    rng = np.random.default_rng(3)
    inside, before = [], []
    for _ in range(200):
        z, y = record(rng, 1.2)
        fit = fit_exponentials(y, np.array([z]))
        factors = widening(y, fit, NONE)
        assert (factors >= 1).all()
        for covariance, into in (
            (widened(fit.log_pole_covariance[0], factors[0]), inside),
            (fit.log_pole_covariance[0], before),
        ):
            mode = mode_from_sampled_pole(complex(fit.poles[0]), covariance, fit.amplitudes[:, 0], RATE)
            f, zeta = mode.frequency_hz, mode.damping_ratio
            into.append(
                (abs(f.value - 733) < 1.96 * f.standard_error, abs(zeta.value - 0.02) < 1.96 * zeta.standard_error)
            )
    assert (np.mean(before, axis=0) < 0.925).all()
    assert (np.mean(inside, axis=0) > 0.92).all()
    assert (np.mean(inside, axis=0) < 0.995).all()
