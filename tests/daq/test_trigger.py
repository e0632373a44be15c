from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from daq.errors import RecordingError
from daq.settings import Trigger
from daq.trigger import NoTap, SamplesLost, find_trigger, record_impact
from rig.errors import RigError
from rig.interface import Accelerometers, Clock, Impactor
from rig.readings import Block

RATE = 10_000.0


class Bench(Accelerometers, Impactor, Clock):
    """A stream that is told sample by sample; a strike is a step of given height some samples after the call."""

    sample_rate_hz = RATE
    full_scale_m_s2 = 50.0
    bits = 16

    def __init__(self, block: int = 64, height: float = 1.0, delay: int = 777, noise: float = 0.0) -> None:
        self.block, self.height, self.delay, self.noise = block, height, delay, noise
        self.position = 0
        self.struck: int | None = None
        self.running = False
        self.hints: list[tuple[float, str]] = []
        self.offset: Callable[[np.ndarray], np.ndarray] = lambda t: 0.3 + 0.0 * t
        self.lose_at: int | None = None
        self.lose_every = False
        self.gap_ends = 0
        self.repeat_at: int | None = None
        self.strain = True
        self.rng = np.random.default_rng(0)

    def now(self) -> float:
        return self.position / RATE

    def sleep(self, seconds: float) -> None:
        self.position += round(seconds * RATE)

    def utc(self) -> str:
        return "2026-01-01T00:00:00.000Z"

    def tap(self, load_mn: float, hint: str = "") -> None:
        assert self.running
        self.hints.append((load_mn, hint))
        self.struck = self.position + self.delay

    def start(self) -> None:
        self.running, self.position = True, 0

    def stop(self) -> None:
        self.running = False

    def read_block(self) -> Block:
        assert self.running
        if self.lose_every or (self.lose_at is not None and self.position >= self.lose_at):
            self.position += 1
            self.lose_at, self.gap_ends = None, self.position
        if self.repeat_at is not None and self.position >= self.repeat_at:
            self.position -= self.block
        n = np.arange(self.position, self.position + self.block)
        a = self.offset(n / RATE) + self.noise * self.rng.normal(size=(2, self.block))
        if self.struck is not None:
            a = a + self.height * (n >= self.struck)
        first = self.position
        self.position += self.block
        return Block(first, a, n.astype(float) if self.strain else None)


SHORT = Trigger(threshold_m_s2=0.1, pretrigger_samples=100, record_samples=1000, timeout_s=1.0)


@pytest.mark.parametrize("block", [1, 7, 64, 5000])
@pytest.mark.parametrize("height", [1.0, -1.0, 0.11])
def test_the_trigger_is_the_first_sample_over(block: int, height: float) -> None:
    bench = Bench(block, height)
    record = record_impact(bench, bench, bench, SHORT, 265.0, "harder")
    assert record.acceleration.shape == (2, 1000)
    assert record.pretrigger == 100
    step = np.diff(record.acceleration[0])
    assert int(np.argmax(np.abs(step))) + 1 == 100
    assert record.strain_mv is not None
    assert bench.struck is not None
    np.testing.assert_array_equal(record.strain_mv, bench.struck - 100 + np.arange(1000.0))
    assert bench.hints == [(265.0, "harder")]
    assert record.time == "2026-01-01T00:00:00.000Z"
    assert not bench.running


def test_a_slow_drift_does_not_trigger() -> None:
    bench = Bench()
    bench.offset = lambda t: 2.0 * np.sin(2 * np.pi * 0.05 * t)
    record = record_impact(bench, bench, bench, SHORT, 265.0)
    assert int(np.argmax(np.abs(np.diff(record.acceleration[0])))) + 1 == 100


def test_a_channel_without_strain_has_none() -> None:
    bench = Bench()
    bench.strain = False
    assert record_impact(bench, bench, bench, SHORT, 265.0).strain_mv is None


def test_noise_over_the_threshold_does_not_trigger() -> None:
    bench = Bench(height=3.0, noise=0.1, delay=9000)
    record = record_impact(bench, bench, bench, SHORT, 265.0)
    assert int(np.argmax(np.abs(np.diff(record.acceleration.mean(axis=0))))) + 1 == 100


def test_no_tap_is_told_and_the_stream_stopped() -> None:
    bench = Bench(height=0.0)
    with pytest.raises(NoTap, match=r"No tap within 1 s: nothing passed 0\.1 m/s2.*upside down.*--scope"):
        record_impact(bench, bench, bench, SHORT, 265.0)
    assert not bench.running
    assert bench.position / RATE == pytest.approx(1.0, abs=0.05)


def test_no_tap_is_told_even_if_the_clock_stands() -> None:
    bench = Bench(height=0.0)
    bench.now = lambda: 0.0  # type: ignore[method-assign]
    with pytest.raises(NoTap):
        record_impact(bench, bench, bench, SHORT, 265.0)


@pytest.mark.parametrize("lose_at", [0, 64, 512])
def test_samples_lost_before_the_tap_cost_nothing(lose_at: int) -> None:
    bench = Bench()
    bench.lose_at = lose_at
    record = record_impact(bench, bench, bench, SHORT, 265.0)
    assert bench.gap_ends == lose_at + 1
    assert bench.struck is not None
    assert record.strain_mv is not None
    assert record.strain_mv[0] == bench.struck - 100
    assert np.array_equal(np.diff(record.strain_mv), np.ones(999))


@pytest.mark.parametrize("before_the_tap", [-899, -1, 0, 99])
def test_a_record_never_spans_lost_samples(before_the_tap: int) -> None:
    bench = Bench(block=1, delay=700)
    bench.lose_at = 100 + 700 - before_the_tap
    with pytest.raises(SamplesLost, match="The recorder lost 1 samples while the tap was waited for"):
        record_impact(bench, bench, bench, SHORT, 265.0)
    assert not bench.running


def test_a_whole_pretrigger_after_the_gap_will_do() -> None:
    bench = Bench(block=1, delay=700)
    bench.lose_at = 100 + 700 - 101
    record = record_impact(bench, bench, bench, SHORT, 265.0)
    assert record.strain_mv is not None
    assert record.strain_mv[0] == bench.gap_ends


def test_a_recorder_that_loses_samples_all_the_time_is_told_in_time() -> None:
    bench = Bench(block=64)
    bench.lose_every = True
    with pytest.raises(SamplesLost, match="lost"):
        record_impact(bench, bench, bench, SHORT, 265.0)
    assert not bench.running


def test_a_tap_that_fell_into_the_gap_is_told_as_lost() -> None:
    bench = Bench(block=64, delay=700, height=0.0)
    bench.lose_at = 512
    with pytest.raises(SamplesLost, match="tap again"):
        record_impact(bench, bench, bench, SHORT, 265.0)


def test_samples_that_come_twice_are_told() -> None:
    bench = Bench()
    bench.repeat_at = 512
    with pytest.raises(RigError, match="again where") as caught:
        record_impact(bench, bench, bench, SHORT, 265.0)
    assert not isinstance(caught.value, NoTap)


def test_a_value_that_is_no_number_is_told() -> None:
    bench = Bench()
    bench.offset = lambda t: np.where(t > 0.03, np.nan, 0.0)
    with pytest.raises(RigError, match="not a number"):
        record_impact(bench, bench, bench, SHORT, 265.0)
    assert not bench.running


def test_the_stream_is_stopped_when_the_impactor_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()

    def fail(load_mn: float, hint: str = "") -> None:
        raise RigError("The solenoid does not answer.")

    monkeypatch.setattr(bench, "tap", fail)
    with pytest.raises(RigError, match="solenoid"):
        record_impact(bench, bench, bench, SHORT, 265.0)
    assert not bench.running


def test_a_pretrigger_as_long_as_the_record_is_refused() -> None:
    with pytest.raises(ValueError, match="pretrigger_samples must be smaller than record_samples"):
        Trigger(pretrigger_samples=300, record_samples=300)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_onset_of_a_finished_record_is_found(sign: int) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(5000) / 25000.0
    ringing = np.where(t >= 0.04, np.exp(-20 * (t - 0.04)) * np.cos(2 * np.pi * 350 * (t - 0.04)), 0.0)
    record = 0.7 + sign * 3 * ringing + 0.003 * rng.normal(size=(2, t.size))
    assert find_trigger(record, 25000.0) == 1000
    assert find_trigger(record[0], 25000.0, threshold=1.0) == 1000


def test_a_record_that_begins_with_its_tap_triggers_at_once() -> None:
    t = np.arange(5000) / 25000.0
    assert find_trigger(np.exp(-20 * t) * np.cos(2 * np.pi * 350 * t), 25000.0) == 0


def test_a_record_without_a_tap_has_no_onset() -> None:
    with pytest.raises(RecordingError, match="there is no tap"):
        find_trigger(np.zeros((2, 500)), 25000.0)
