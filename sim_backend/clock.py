"""Time of the simulated rig: virtual, and paced by the wall clock if asked for."""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta

from rig import Clock

EPOCH = datetime(2026, 1, 1, tzinfo=UTC)
"""Date of virtual time 0, the same in every run, where nobody says another."""


class VirtualClock(Clock):
    """Passes only when someone lets it.

    Parameters
    ----------
    realtime
        Whether letting time pass also takes that long.
    speed
        How many times faster than that.

    Attributes
    ----------
    began
        Date of virtual time 0: in a session the date of its beginning, so that what it notes has dates that follow it.
    """

    def __init__(self, realtime: bool = False, speed: float = 1.0):
        self.time_s = 0.0
        self.began = EPOCH
        self._realtime = realtime
        self._speed = speed

    def now(self) -> float:
        """Virtual time since the rig was made, s."""
        return self.time_s

    def sleep(self, seconds: float) -> None:
        """Let ``seconds`` pass; less than none is none."""
        if seconds > 0:
            if self._realtime:
                time.sleep(seconds / self._speed)
            self.time_s += seconds

    def sleep_until(self, time_s: float) -> None:
        """Let time pass until exactly ``time_s``, if that lies ahead."""
        if time_s > self.time_s:
            if self._realtime:
                time.sleep((time_s - self.time_s) / self._speed)
            self.time_s = time_s

    def utc(self) -> str:
        """Virtual date and time."""
        date = self.began + timedelta(seconds=self.time_s)
        return date.strftime("%Y-%m-%dT%H:%M:%S.") + f"{date.microsecond // 1000:03d}Z"


class RunningClock(VirtualClock):
    """Passes by itself, as fast as the machine's: for devices in a process of their own, whom nobody waits for."""

    def __init__(self) -> None:
        self._origin_s = time.monotonic()
        super().__init__(realtime=True)

    @property
    def time_s(self) -> float:
        """Seconds since it was made or set."""
        return time.monotonic() - self._origin_s

    @time_s.setter
    def time_s(self, value: float) -> None:
        self._origin_s = time.monotonic() - value

    def sleep(self, seconds: float) -> None:
        """Wait; less than none is none."""
        if seconds > 0:
            time.sleep(seconds)

    def sleep_until(self, time_s: float) -> None:
        """Wait until ``time_s``, if that lies ahead."""
        self.sleep(time_s - self.now())
