"""The stream as it is looked at: traces, triggers, levels, on a recorder that plays what it is given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.live_signals import COLUMNS, LiveSignals, TapWindow
from rig import Accelerometers, Block, RigError

RATE, BLOCK = 25_000.0, 256


class Playing(Accelerometers):
    """Plays samples (2, n) block by block; ``lost`` leaves out blocks."""

    sample_rate_hz, full_scale_m_s2, bits = RATE, 49.0, 16

    def __init__(self, samples, lost=()):
        self._samples, self._at, self._lost = samples, 0, set(lost)

    def start(self):
        pass

    def stop(self):
        pass

    def read_block(self):
        while self._at // BLOCK in self._lost:
            self._at += BLOCK
        first, self._at = self._at, self._at + BLOCK
        if self._at > self._samples.shape[1]:
            raise RigError("the end")
        return Block(first, self._samples[:, first : self._at])


def played(samples, lost=(), **view):
    """Signals after all of it was read."""
    shown = {"averages": 8, "span_ms": 50.0, "triggered": False, "level_m_s2": 0.05, **view}
    signals = LiveSignals(Playing(samples, lost), **shown)
    with pytest.raises(RigError, match="the end"):
        while True:
            signals.read()
    return signals


def noise(seconds, rms=0.001):
    return rms * np.random.default_rng(1).standard_normal((2, round(seconds * RATE)))


def test_a_free_trace_is_the_newest_samples():
    samples = noise(1.0)
    trace = played(samples).trace()
    read = samples.shape[1] // BLOCK * BLOCK
    assert np.array_equal(trace.acceleration, samples[:, read - 1250 : read])
    assert (trace.first_ms, trace.step_ms) == pytest.approx((-50.0, 0.04))


def test_a_long_trace_keeps_every_extreme():
    samples = noise(2.2)
    samples[0, 40_000], samples[1, 40_017] = 3.0, -4.0
    trace = played(samples, span_ms=2000.0).trace()
    assert trace.acceleration.shape == (2, 2 * COLUMNS)
    assert trace.acceleration[0].max() == 3.0
    assert trace.acceleration[1].min() == -4.0
    at = trace.first_ms + trace.step_ms * np.argmax(trace.acceleration[0])
    read = samples.shape[1] // BLOCK * BLOCK
    assert at == pytest.approx((40_000 - read) / RATE * 1e3, abs=4 * trace.step_ms)


@pytest.mark.parametrize("channel", [0, 1])
def test_a_triggered_trace_begins_at_the_tap_of_either_channel(channel):
    samples = noise(1.0)
    samples[channel, 12_345:12_400] = 0.4
    trace = played(samples, triggered=True).trace()
    assert trace.first_ms == pytest.approx(-5.0)
    trigger = round(-trace.first_ms / trace.step_ms)
    assert np.array_equal(trace.acceleration, samples[:, 12_345 - trigger : 12_345 - trigger + 1250])


def test_opposite_channels_trigger_although_their_mean_is_zero():
    samples = noise(1.0)
    samples[:, 12_345:12_400] += [[0.4], [-0.4]]
    assert played(samples, triggered=True).trace() is not None


def test_noise_does_not_trigger_however_low_the_level():
    assert played(noise(2.0), triggered=True, level_m_s2=1e-6).trace() is None


def test_a_tap_is_shown_although_the_one_before_still_rang_when_the_wait_for_it_began():
    samples, t = noise(6.0), np.arange(round(3.0 * RATE)) / RATE
    for begin, size in ((1.0, 1.2), (3.0, 0.7)):
        first = round(begin * RATE)
        samples[:, first : first + t.size] += size * np.exp(-2 * t) * np.sin(2 * np.pi * 356 * t)
    trace = played(samples, span_ms=50.0, triggered=True).trace()
    assert np.abs(trace.acceleration).max() == pytest.approx(0.7, rel=0.05)


def test_levels():
    t = np.arange(round(3 * RATE)) / RATE
    samples = np.stack([2.0 * np.sin(2 * np.pi * 100.0 * t), np.full_like(t, 0.25)])
    a, b = played(samples).levels()
    assert (a.rms_m_s2, a.peak_m_s2, a.share) == pytest.approx((2 / np.sqrt(2), 2.0, 2.0 / 49.0), rel=1e-3)
    assert (b.rms_m_s2, b.peak_m_s2, b.share) == pytest.approx((0.0, 0.0, 0.25 / 49.0), abs=1e-12)
    assert b.noise_m_s2 == 0.0


def test_noise_is_that_between_taps():
    samples = noise(3.0, rms=0.002)
    samples[:, 50_000:60_000] += 1.0  # 0.4 s of the last two
    assert played(samples).levels()[0].noise_m_s2 == pytest.approx(0.002, rel=0.05)


def test_an_overload_is_told_for_two_seconds_and_of_its_channel():
    samples = noise(4.0)
    samples[1, 2000] = 49.0
    assert [level.overloaded for level in played(samples[:, : round(1.9 * RATE)]).levels()] == [False, True]
    assert [level.overloaded for level in played(samples).levels()] == [False, False]


def test_no_record_spans_lost_samples():
    samples = noise(2.0)
    samples[:, 30_000:] += 0.5
    gap = 29_000 // BLOCK
    signals = LiveSignals(Playing(samples, [gap]), 8, 50.0, False, 0.05)
    window = TapWindow(2500, 500, RATE, 0.05, 0)
    found = []
    with pytest.raises(RigError, match="the end"):
        while True:
            signals.read()
            record = window.feed(signals.stream)
            if record is not None:
                found.append(record)
                window = TapWindow(2500, 500, RATE, 0.05, signals.stream.end)
    assert signals.lost == BLOCK
    assert found == []  # there were not 2500 whole samples before the step


def test_what_is_kept_is_bounded():
    signals = played(noise(6.0))
    assert signals.stream.end - signals.stream.begin <= 2.5 * RATE + BLOCK


class WithForce(Playing):
    """A recorder with a hammer, whose force is a tenth of the second channel."""

    def read_block(self):
        block = super().read_block()
        return replace(block, force=0.1 * block.acceleration[1])


def test_the_force_is_shown_with_the_accelerations_on_the_same_columns():
    samples = noise(2.2)
    samples[1, 40_017] = 30.0
    for span_ms, points in ((50.0, 1250), (2000.0, 2 * COLUMNS)):
        signals = LiveSignals(WithForce(samples, []), 16, span_ms, False, 0.05)
        with pytest.raises(RigError, match="the end"):
            while True:
                signals.read()
        trace = signals.trace()
        assert (trace.acceleration.shape, trace.force.shape) == ((2, points), (points,))
        assert np.allclose(trace.force, 0.1 * trace.acceleration[1])
    assert trace.force.max() == pytest.approx(3.0)
    assert played(samples).trace().force is None


def test_a_tap_is_found_in_the_force_although_neither_accelerometer_saw_it():
    samples = noise(1.0)
    samples[1, 12_345:12_360] = 0.04  # below what an acceleration triggers at, above 3 mN
    for by_force, expected in ((True, [12_345 - 250]), (False, [])):
        signals = LiveSignals(WithForce(samples, []), 16, 50.0, False, 0.05)
        window, found = TapWindow(250, 1000, RATE, 0.003 if by_force else 0.05, 0, by_force), []
        with pytest.raises(RigError, match="the end"):
            while True:
                signals.read()
                if window.feed(signals.stream) is not None:
                    found.append(window.found)
                    window = TapWindow(250, 1000, RATE, 0.003, signals.stream.end, by_force)
        assert found == expected
