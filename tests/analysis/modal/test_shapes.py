"""The modal assurance criterion and the phase collinearity against their definitions, written out."""

from __future__ import annotations

import doctest

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.modal import shapes
from analysis.modal.shapes import modal_assurance, phase_collinearity, scaled

SEEDS = st.integers(0, 2**32 - 1)


def drawn(seed: int, channels: int = 4, modes: int = 3):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((channels, modes)) + 1j * rng.standard_normal((channels, modes))


@given(SEEDS)
def test_mac_is_the_squared_cosine_of_the_angle_between_two_shapes(seed):
    a, b = drawn(seed), drawn(seed + 1, modes=2)
    found = modal_assurance(a, b)
    for i in range(3):
        for j in range(2):
            inner = sum(x.conjugate() * y for x, y in zip(a[:, i], b[:, j], strict=True))
            lengths = sum(abs(x) ** 2 for x in a[:, i]) * sum(abs(y) ** 2 for y in b[:, j])
            assert found[i, j] == pytest.approx(abs(inner) ** 2 / lengths, rel=1e-12)


@given(SEEDS)
def test_a_factor_changes_nothing_and_a_shape_is_itself(seed):
    a = drawn(seed)
    assert np.diag(modal_assurance(a, a * (2 - 3j))) == pytest.approx(np.ones(3), rel=1e-12)
    assert modal_assurance(a, a) == pytest.approx(modal_assurance(a * 5j, a), rel=1e-12)


def test_shapes_of_a_chain_of_equal_masses_are_orthogonal():
    n = 5
    eigenvectors = np.linalg.eigh(2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))[1].astype(complex)
    assert modal_assurance(eigenvectors, eigenvectors) == pytest.approx(np.eye(n), abs=1e-12)


def test_unlike_channels_are_refused_and_a_shape_of_zeros_is_no_number():
    with pytest.raises(ValueError, match="shapes of 4 and of 3 channels"):
        modal_assurance(drawn(1), drawn(1, channels=3))
    assert np.isnan(modal_assurance(np.zeros((2, 1), complex), np.ones((2, 1), complex))).all()


def test_collinearity_of_one_phase_and_of_a_travelling_wave():
    turned = np.array([1.0, -2.0, 3.0]) * np.exp(0.7j)
    wave = np.exp(2j * np.pi * np.arange(3) / 3)
    assert phase_collinearity(np.stack([turned, wave], axis=1)) == pytest.approx([1.0, 0.0], abs=1e-12)


def test_collinearity_of_one_channel_is_no_number():
    assert np.isnan(phase_collinearity(np.ones((1, 3), complex))).all()


def test_the_largest_channel_becomes_one():
    assert scaled(np.array([1j, -2.0, 0.5])) == pytest.approx(np.array([-0.5j, 1.0, -0.25]))
    assert not scaled(np.zeros(2, complex)).any()


def test_the_example():
    assert doctest.testmod(shapes).failed == 0
