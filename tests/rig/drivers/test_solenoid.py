"""The solenoid impactor: one pulse, of the right length, and always switched off."""

from __future__ import annotations

import math

import pytest

from rig import RigError
from rig.drivers.recorder_settings import SolenoidSettings
from rig.drivers.solenoid import SolenoidImpactor
from sim_backend.clock import VirtualClock


class Lines:
    """Digital lines that note what is done to them, and fail when told."""

    def __init__(self, clock: VirtualClock, failing: tuple[int, ...] = ()) -> None:
        self.clock = clock
        self.failing = failing
        self.calls: list[tuple[int, bool, float]] = []

    def set_line(self, line: int, high: bool) -> None:
        self.calls.append((line, high, self.clock.now()))
        if len(self.calls) in self.failing:
            raise RigError("recorder: gone")


def solenoid(*failing: int, **changes) -> tuple[SolenoidImpactor, Lines]:
    clock = VirtualClock()
    lines = Lines(clock, failing)
    return SolenoidImpactor(lines, SolenoidSettings(**changes), clock), lines


def pulse_ms(impactor: SolenoidImpactor, lines: Lines, load_mn: float = 0.0, hint: str = "") -> float:
    lines.calls.clear()
    impactor.tap(load_mn, hint)
    (_, on, begin), (_, off, end) = lines.calls
    assert (on, off) == (True, False)
    return (end - begin) * 1e3


def test_a_pulse_grows_with_the_preload_up_to_the_longest():
    impactor, lines = solenoid(line=5, pulse_ms=3.0, pulse_ms_per_n=4.0, longest_pulse_ms=6.0)
    assert pulse_ms(impactor, lines) == pytest.approx(3.0)
    assert pulse_ms(impactor, lines, 500.0) == pytest.approx(5.0)
    assert pulse_ms(impactor, lines, 1000.0) == pytest.approx(6.0)
    assert {line for line, *_ in lines.calls} == {5}


def test_it_learns_from_what_was_wrong_within_bounds():
    impactor, lines = solenoid(pulse_ms=4.0)
    assert pulse_ms(impactor, lines, hint="too weak: ...: tap harder") == pytest.approx(4.0 * 1.15)
    assert pulse_ms(impactor, lines, hint="the load moved: let it settle") == pytest.approx(4.0 * 1.15)
    assert pulse_ms(impactor, lines, hint="clipped: tap more gently") == pytest.approx(4.0)
    for _ in range(20):
        pulse_ms(impactor, lines, hint="tap more gently")
    assert pulse_ms(impactor, lines) == pytest.approx(2.0)
    for _ in range(20):
        pulse_ms(impactor, lines, hint="tap harder")
    assert pulse_ms(impactor, lines) == pytest.approx(8.0)


def test_a_line_that_fails_to_rise_is_lowered_all_the_same():
    impactor, lines = solenoid(1)
    with pytest.raises(RigError, match="recorder: gone"):
        impactor.tap(0.0)
    assert lines.calls[-1][1] is False


def test_a_line_that_fails_to_fall_is_tried_again():
    impactor, lines = solenoid(2)
    impactor.tap(0.0)
    assert [high for _, high, _ in lines.calls] == [True, False, False]


def test_a_line_that_stays_up_is_told():
    impactor, _ = solenoid(2, 3)
    with pytest.raises(
        RigError, match=r"solenoid: it may still be under current \(recorder: gone\); switch its supply"
    ):
        impactor.tap(0.0)


@pytest.mark.parametrize("load", [math.nan, -1.0])
def test_an_unknown_preload_is_refused(load):
    impactor, lines = solenoid()
    with pytest.raises(RigError, match="the load must be known"):
        impactor.tap(load)
    assert not lines.calls
