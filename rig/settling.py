"""Waiting until a gauge whose amplifier averages over longer than a step takes shows what it is going to show."""

from __future__ import annotations

import math
from collections.abc import Callable

from rig.interface import HEED_S, Clock, nothing
from rig.readings import LoadReading

SLICE_S = 0.1  # between two looks meanwhile
MOST_TURNS = 10  # settling times after which it has not settled
STANDARD_ERRORS = 3.0  # of the difference of two readings that says nothing


def rest(clock: Clock, seconds: float, heed: Callable[[], None]) -> None:
    """Let time pass, and call ``heed`` every 20 ms of it; what it raises ends that."""
    begun = clock.now()
    for turn in range(1, math.ceil(seconds / HEED_S) + 1):
        clock.sleep(begun + min(turn * HEED_S, seconds) - clock.now())
        heed()


def let_settle(
    clock: Clock,
    settling_s: float,
    read: Callable[[], LoadReading],
    within_mv: float = 0.0,
    heed: Callable[[], None] = nothing,
) -> bool:
    """Read until two readings a settling time apart are the same.

    Parameters
    ----------
    clock
        Rig time.
    settling_s
        `LoadCell.settling_s`; 0 waits for nothing.
    read
        One reading; called several times in a settling time, so that the load is watched meanwhile.
    within_mv
        Difference that does not matter, mV; noise and the amplifier's smallest step never do.
    heed
        Called again and again between two looks; what it raises ends the waiting.

    Returns
    -------
    bool
        Whether it settled within ten settling times.
    """
    if not settling_s:
        return True
    before = read()
    for _ in range(MOST_TURNS):
        until = clock.now() + settling_s
        while True:
            now = read()
            left = until - clock.now()
            if left <= 0:
                break
            rest(clock, min(left, SLICE_S), heed)
        noise = math.hypot(*(r.spread_mv / math.sqrt(r.samples) for r in (before, now)))
        if abs(now.voltage_mv - before.voltage_mv) <= max(within_mv, STANDARD_ERRORS * noise + now.quantum_mv):
            return True
        before = now
    return False
