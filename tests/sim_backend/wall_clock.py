"""Time as it passes, for emulated devices that programs of others talk to."""

from __future__ import annotations

import time

from sim_backend.clock import VirtualClock


class WallClock(VirtualClock):
    """The rig's time is the wall's; letting it pass takes that long."""

    def __init__(self) -> None:
        self._begun_s = time.monotonic()

    @property
    def time_s(self) -> float:
        return time.monotonic() - self._begun_s

    def now(self) -> float:
        return self.time_s

    def sleep(self, seconds: float) -> None:
        time.sleep(max(seconds, 0.0))

    def sleep_until(self, time_s: float) -> None:
        self.sleep(time_s - self.time_s)
