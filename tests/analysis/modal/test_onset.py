"""Taps that are not as they should be: wrong trigger, clipped, a long pulse, nothing but noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.modal.noise import NoiseModel
from analysis.modal.onset import Onset, onset_of
from analysis.modal.tester import identify_impacts
from daq.records import RigDescription

RATE = 25_000.0
QUIET = 250
NONE = np.zeros(0, np.int64)


def description(f1):
    k = 0.215 / 2 * (2 * math.pi * f1) ** 2
    return RigDescription(0.107, 0.108, k, k, RATE, math.nan, 1, 10000.0, 4, "none", 50.0, 16)


def driven(f, zeta, pulse_s, t):
    """One mode driven by a half-sine of unit height from t = 0 on, by quadrature."""
    omega = 2 * np.pi * f
    damped = omega * np.sqrt(1 - zeta**2)
    impulse = np.where(t >= 0, np.exp(-zeta * omega * np.maximum(t, 0)) * np.sin(damped * t), 0.0)
    force = np.where((t > 0) & (t < pulse_s), np.sin(np.pi * t / pulse_s), 0.0)
    return np.convolve(force, impulse)[QUIET : QUIET + t.size]


def taps(f2, zeta2, rng, pulse_s=0.3e-3, sigma=0.01, count=4, system=1.0):
    records = []
    t = (np.arange(4000) - QUIET) / RATE
    for _ in range(count):
        y = system * driven(281.0, 0.002, pulse_s, t) + rng.uniform(0.8, 1.2) * driven(f2, zeta2, pulse_s, t)
        records.append(y / np.abs(y).max() + sigma * rng.standard_normal(t.size))
    return records


def contact_scores(found, f2, zeta2):
    modes = [m.contact for m in found]
    assert all(m is not None for m in modes)
    return [
        (e.value - true) / e.standard_error
        for m in modes
        for e, true in ((m.frequency_hz, f2), (m.damping_ratio, zeta2))
    ]


@pytest.mark.parametrize("off", [-25, 25])
def test_a_trigger_a_millisecond_off_changes_no_mode(off):
    records = taps(733.0, 0.17, np.random.default_rng(1))
    found = identify_impacts(records, [QUIET + off] * 4, RATE, description(281), NoiseModel(np.ones(1), 1e-4))
    assert np.abs(contact_scores(found, 733.0, 0.17)).max() < 4
    assert any("trigger" in note for note in found[0].notes)


def test_a_pulse_of_two_milliseconds_is_waited_for():
    records = taps(700.0, 0.03, np.random.default_rng(2), pulse_s=2e-3)
    found = identify_impacts(records, [QUIET] * 4, RATE, description(281), NoiseModel(np.ones(1), 1e-4))
    assert np.abs(contact_scores(found, 700.0, 0.03)).max() < 4
    assert min(m.start for m in found) > QUIET + 45


def test_what_is_clipped_is_not_fitted():
    records = [np.clip(r, -0.6, 0.6) for r in taps(733.0, 0.03, np.random.default_rng(3), system=0.3)]
    found = identify_impacts(records, [QUIET] * 4, RATE, description(281), NoiseModel(np.ones(1), 1e-4))
    assert np.abs(contact_scores(found, 733.0, 0.03)).max() < 4
    assert all(np.abs(r[m.start :]).max() < 0.6 for r, m in zip(records, found, strict=True))
    assert any("clipped" in note for note in found[0].notes)


def test_a_contact_mode_in_the_noise_is_refused_with_the_reason():
    records = taps(733.0, 0.17, np.random.default_rng(4), sigma=0.5)
    found = identify_impacts(records, [QUIET] * 4, RATE, description(281), NoiseModel(np.ones(1), 0.25))
    assert all(m.contact is None for m in found)
    assert any("noise" in note for note in found[0].notes)


def test_a_right_trigger_is_believed():
    tap = np.append(np.zeros(250), np.cos(0.3 * np.arange(1000)))
    assert onset_of(tap, 248, NONE, RATE, NoiseModel(np.ones(1), 1e-6)).usable == 248
    assert onset_of(tap, 100, NONE, RATE, NoiseModel(np.ones(1), float("nan"))).usable == 100


def test_a_burst_of_noise_ahead_of_a_tap_is_not_its_beginning():
    rng = np.random.default_rng(3)
    t = np.arange(1250) / RATE
    tap = np.append(np.zeros(250), 3 * np.exp(-60 * t) * np.cos(2 * np.pi * 1500 * t)) + 1e-3 * rng.standard_normal(
        1500
    )
    tap[100:400] += 0.02 * rng.standard_normal(300)  # twenty times the noise, a hundredth of the tap
    noise = NoiseModel(np.ones(1), 1e-6)
    assert onset_of(tap, 250, NONE, RATE, noise) == Onset(250)
    late = onset_of(tap, 330, NONE, RATE, noise)  # where the trigger is wrong, it is seen all the same
    assert late.usable == 250
    assert late.notes == ("the tap begins -3.2 ms from where its trigger is said to be",)
