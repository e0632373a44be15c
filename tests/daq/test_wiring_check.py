"""What one tap tells of the wiring, on signals that no simulated rig made."""

from __future__ import annotations

import numpy as np
import pytest

from daq.wiring_check import check_wiring
from tests.daq.taps_of_two import RATE, TRIGGER, motion, noise, rocking

FULL_SCALE, BITS, WINDOW_MS = 49.0, 16, 3.0
STEP = 2 * FULL_SCALE / 2**BITS
ONE_LINE = 0.004


def checked(a, b, seed=1, rms=0.001, added=0.0):
    record = np.stack([a, b]) + noise(np.random.default_rng(seed), rms) + added
    record = np.clip(STEP * np.round(record / STEP), -FULL_SCALE, FULL_SCALE - STEP)
    return check_wiring(record, TRIGGER, RATE, FULL_SCALE, BITS, WINDOW_MS)


def line(hz, amplitude_a, amplitude_b):
    t = np.arange(motion().size) / RATE
    return np.stack([amplitude_a * np.sin(2 * np.pi * hz * t), amplitude_b * np.cos(2 * np.pi * hz * t)])


def test_two_that_see_the_same():
    found = checked(motion(), motion())
    assert (found.alive, found.clipped, found.lines) == ((True, True), (False, False), (None, None))
    assert found.noise_m_s2 == pytest.approx((0.001, 0.001), rel=0.1)
    assert found.peak_m_s2 == pytest.approx(found.first_swing_m_s2, rel=0.01)
    assert found.rotation < 0.01
    assert found.relation.gain == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_first_swing_has_the_sign_of_the_push(sign):
    found = checked(sign * motion(), -sign * motion())
    assert np.sign(found.first_swing_m_s2) == pytest.approx([sign, -sign])
    assert found.relation.gain == pytest.approx(-1.0, abs=0.005)


@pytest.mark.parametrize("crosstalk", [0.0, 0.01])
def test_a_dead_channel_is_told_from_one_that_is_coupled(crosstalk):
    found = checked(crosstalk * motion(10.0), motion(10.0))
    assert found.alive == (False, True)
    assert found.relation is None
    assert np.isnan(found.rotation)
    assert checked(0.1 * motion(10.0), motion(10.0)).alive == (True, True)


def test_noise_alone_is_no_tap():
    assert not any(any(checked(0 * motion(), 0 * motion(), seed).alive) for seed in range(20))


def test_a_clipped_channel_has_no_relation():
    found = checked(motion(80.0), motion(8.0))
    assert (found.clipped, found.relation) == ((True, False), None)


def test_a_rotation_is_seen_whatever_gain_and_delay():
    assert checked(motion(), 0.5 * motion(1.0, 3.0)).rotation < 0.02
    assert checked(motion() + rocking(0.5), motion() - rocking(0.5)).rotation > 0.15


def test_who_is_nearer_to_the_tap_is_ahead_on_the_first_flank():
    found = checked(motion() + rocking(0.6, hz=1000.0), motion() - rocking(0.6, hz=1000.0))
    assert found.onset_m_s2[0] > 1.1 * found.onset_m_s2[1]


@pytest.mark.parametrize("hz", [50.0, 49.9, 60.0, 60.1, 150.0])
def test_a_line_of_the_mains_is_found_with_its_size(hz):
    found = checked(motion(), motion(), added=line(hz, 0.0, ONE_LINE))
    assert found.lines[0] is None
    assert found.lines[1].rms_m_s2 == pytest.approx(ONE_LINE / np.sqrt(2), rel=0.1)
    assert found.lines[1].mains_hz == (60.0 if round(hz) % 50 else 50.0)


def test_noise_has_no_lines_and_another_tone_is_none_of_the_mains():
    assert all(checked(motion(), motion(), seed).lines == (None, None) for seed in range(40))
    assert checked(motion(), motion(), added=line(83.0, ONE_LINE, ONE_LINE)).lines == (None, None)
