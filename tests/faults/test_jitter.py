"""Wires whose times vary from message to message, and a retraction whose order for speed is damaged."""

from __future__ import annotations

import random

import pytest

from mesotap.session.states import State
from rig import SessionAborted
from rig.drivers.reply_time import LATE_REPLIES, LONGEST_WAIT_S, ROUND_TRIPS, ReplyTime
from tests.faults.bench import TCP, FaultyBench, allowed_mn, quick_config

SAFE_WITHIN_S = 0.5


def vary(transport, halves_s, seed: int) -> None:
    """Draw the way there and back of every message anew."""
    drawn, write = random.Random(seed), transport.write

    def varied(data: bytes) -> None:
        transport._half_s = drawn.choice(halves_s)
        write(data)

    transport.write = varied


@pytest.mark.parametrize("config", [quick_config(), quick_config(*TCP)], ids=["serial", "TCP and SMC100"])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("longest_s", [0.03, 0.06])
def test_a_wire_that_varies_carries_a_session_out(tmp_path, config, seed, longest_s):
    bench = FaultyBench(tmp_path / "s", config, seed)
    for i, part in enumerate((bench.rig.stage, bench.rig.load_cell)):
        vary(part._transport, (0.0, 0.2 * longest_s, 0.3 * longest_s, 0.5 * longest_s), 10 * seed + i)
    for _ in range(3):
        outcome = bench.run()
        assert bench.rig.physics.peak_true_load_mn <= allowed_mn(config)
        if outcome.error is None:
            break
        assert bench.rig.physics.true_load_mn() == 0.0, outcome.reads
    assert outcome.error is None, outcome.reads


def test_the_wait_grows_with_what_comes_late_and_not_with_one():
    wait = ReplyTime(None)
    for _ in range(ROUND_TRIPS):
        wait.learn(0.001)
    usual = wait.limit_s
    wait.came_late()
    assert wait.limit_s == usual
    for _ in range(LATE_REPLIES - 1):
        wait.came_late()
    assert wait.limit_s > usual
    assert wait.round_trip_s >= usual, "a reply that came after the wait took longer than it"
    for _ in range(20):
        wait.came_late()
    assert wait.limit_s <= 1.2 * LONGEST_WAIT_S + 0.02


def test_a_wait_that_was_given_stays():
    wait = ReplyTime(0.1)
    for _ in range(10):
        wait.came_late()
    assert wait.limit_s == 0.1


def end(damaged: list[str]) -> None:
    damaged.append("next")
    raise SessionAborted("ended by the operator")


@pytest.mark.parametrize("order", [b"1VA0.000200", b"1VA0.001000"], ids=["a thousandth", "two hundredth"])
@pytest.mark.parametrize("round_trip_s", [0.0, 0.026, 0.05])
def test_an_order_for_speed_that_was_damaged_is_given_again(tmp_path, round_trip_s, order):
    config = quick_config()
    bench = FaultyBench(tmp_path / "s", config, round_trip_s=round_trip_s)
    request, damaged = bench.stage_wire.request, []

    def slower(data: bytes) -> bytes:
        if damaged == ["next"] and data.startswith(b"1VA"):
            damaged.append("done")
            return order + b"\r\n"
        return request(data)

    bench.stage_wire.request = slower
    bench.when(State.TAP, 1, 3, lambda: end(damaged))
    outcome = bench.run()
    assert damaged == ["next", "done"]
    assert bench.rig.physics.true_load_mn() == 0.0
    assert outcome.apart_s - outcome.noticed_s <= SAFE_WITHIN_S + 0.2 + 4 * round_trip_s, outcome.reads


def test_a_slow_wire_leaves_time_for_the_recorder(tmp_path):
    bench = FaultyBench(tmp_path / "s", quick_config(), 2, round_trip_s=0.06)
    outcome = bench.run()
    assert outcome.error is None, outcome.reads


def test_a_pause_while_a_slow_wire_is_looked_at_makes_no_reading_old(tmp_path):
    bench = FaultyBench(tmp_path / "s", quick_config(), 1, round_trip_s=0.03)
    gauge, clock = bench.rig.load_cell, bench.rig.clock
    bench.rig.open()
    gauge.idle = lambda: clock.sleep(20.0)
    reading = gauge.read(0.0)
    assert reading.samples == 1
    assert clock.now() - reading.time_s <= 0.031
