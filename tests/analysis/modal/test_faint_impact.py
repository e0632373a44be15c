"""Taps that are no louder than the noise of their record: when they were, and what their modes may be."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.modal.faint_impact import begun_in_noise
from analysis.modal.identify import identify_ring_down
from analysis.modal.model_order import modes_of
from analysis.modal.ring_down_model import Record

RATE, QUIET, SAMPLES = 25_000.0, 250, 4000


def tap(damping, sigma, rng):
    """A decay at 281 Hz and one at 733 Hz after a pulse of 0.3 ms, in noise: (1, n)."""
    omega = 2 * np.pi * np.array([281.0, 733.0])
    zeta = np.array([0.002, damping])
    s = (-zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)) / RATE
    y = np.zeros(SAMPLES)
    y[QUIET:] = 0.5 * np.exp(np.outer(s, np.arange(SAMPLES - QUIET))).imag.sum(axis=0)
    y[QUIET - 8 : QUIET] += 0.7 * np.sin(np.pi * (np.arange(8) + 0.5) / 8)
    return (y + sigma * rng.standard_normal(SAMPLES))[None]


def contact_modes(damping, sigma, seeds):
    """Modes above the lower one of taps drawn with each seed."""
    for seed in seeds:
        found = identify_ring_down(tap(damping, sigma, np.random.default_rng(seed)), RATE, largest_order=0)
        yield from (m for m in found.modes if m.frequency_hz.value > 350)


def test_a_mode_is_not_taken_to_begin_before_its_tap_and_to_decay_slowly():
    found = list(contact_modes(0.02, 0.52, range(8)))
    off = [(m.damping_ratio.value - 0.02) / m.damping_ratio.standard_error for m in found]
    assert len(found) > 4
    assert np.abs(off).max() < 4


def test_what_has_decayed_when_the_tap_is_surely_over_is_left_out():
    y = tap(0.03, 0.5, np.random.default_rng(12))
    found = identify_ring_down(y, RATE, largest_order=0)
    assert [round(m.frequency_hz.value, -1) for m in found.modes] == [280.0]
    assert any("it may be part of the impact and is left out" in note for note in found.notes)


def test_the_onset_widens_the_interval_of_a_fast_decay_and_not_of_a_slow_one():
    y = tap(0.02, 0.3, np.random.default_rng(3))
    record = Record(y - y.mean())
    begun = begun_in_noise(record, modes_of(record), RATE)
    assert begun is not None
    assert begun.start == pytest.approx(QUIET + 25, abs=50)
    slow, fast = np.argsort(np.abs(np.log(begun.model.poles)))
    assert begun.scatter[fast, 0, 0] > 10 * begun.scatter[slow, 0, 0] > 0


def test_decays_from_the_first_sample_on_have_no_onset():
    k = np.arange(SAMPLES)
    y = 0.998**k * np.cos(0.3 * k) + 0.5 * np.random.default_rng(4).standard_normal(SAMPLES)
    record = Record(y[None])
    assert begun_in_noise(record, modes_of(record), RATE) is None
