"""Modes carried from step to step, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from sim_backend.modal_response import parabolas, respond, step_weights, waves


@pytest.mark.parametrize("s", [-30.0 + 4000.0j, -2e4 + 6e4j, -5.0 + 0.0j, 0.0j, 12.0 - 3e3j])
def test_powers_of_a_step_are_the_exponential(s: complex) -> None:
    h, n = 4e-5, 5000
    exact = np.exp(s * h * np.arange(n))
    found = waves(np.array([s, 2 * s]), h, n)
    assert np.abs(found[:, 0] - exact).max() < 1e-12 * np.abs(exact).max()
    assert np.abs(found[:, 1] - exact**2).max() < 1e-11 * np.abs(exact**2).max()


def _response_of_a_mode(s: complex, h: float, force: np.ndarray) -> np.ndarray:
    weights, residue = step_weights(np.array([s]), h)[None], np.ones((1, 1, 1, 1), np.complex128)
    forces = force[None, None].copy()
    return respond(forces, parabolas(forces), weights, residue, np.array([1.0]), np.zeros((1, 1, 1)), 1)[0, 0]


@pytest.mark.parametrize("s", [-30.0 + 4000.0j, -1.0 + 30.0j, -2e4 + 6e4j])
def test_the_response_of_a_mode_to_a_ramp_is_exact(s: complex) -> None:
    h = 1e-5
    t = h * np.arange(500)
    found = _response_of_a_mode(s, h, t)
    expected = ((np.exp(s * t) - 1 - s * t) / s**2).real
    assert np.allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_the_response_of_a_mode_to_an_oscillating_force_is_wrong_by_the_third_power_of_the_step() -> None:
    s, omega = -30.0 + 12000.0j, 9000.0
    errors = []
    for h in (2e-5, 1e-5):
        t = h * np.arange(round(2e-2 / h))
        found = _response_of_a_mode(s, h, np.sin(omega * t))
        expected = (((1j * omega - s) * 1j) ** -1 * (np.exp(1j * omega * t) - np.exp(s * t)) / 2).real
        expected += (-(((-1j * omega - s) * 1j) ** -1) * (np.exp(-1j * omega * t) - np.exp(s * t)) / 2).real
        errors.append(np.abs(found - expected)[10:].max() / np.abs(expected).max())
    assert errors[1] < 5e-4
    assert errors[1] < errors[0] / 6


def test_what_dies_out_ends_in_nothing_and_leaves_the_rest_as_it_is() -> None:
    # below 1e-308 numbers lose their digits, and arithmetic with them takes a hundred times as long
    h, n = 1e-5, 4000
    poles = np.array([-30 + 700j, -4e4 + 3e4j])
    force = np.zeros((1, 1, n))
    force[0, 0] = np.exp(-np.arange(n) * h / 1e-5)
    force[0, 0, 3000:] = 1.0  # what comes later finds the modes as they are
    weights, residues, pairs = step_weights(poles[None], h), np.ones((1, 1, 1, 2), complex), np.array([2.0, 2.0])
    found = respond(force, parabolas(force), weights, residues, pairs, np.zeros((1, 1, 1)), 1)[0, 0]
    alone = np.zeros(2, complex)
    w, bends, expected = weights[0], parabolas(force)[0, 0], [0.0]
    for k in range(1, n):
        alone = w[0] * alone + w[1] * force[0, 0, k - 1] + w[2] * force[0, 0, k] + w[3] * bends[k - 1]
        expected.append(float(np.sum(2 * alone.real)))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
