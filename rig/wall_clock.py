"""Time on the bench: what a real rig's clock reads."""

from __future__ import annotations

import time
from datetime import UTC, datetime

from rig.interface import Clock


class WallClock(Clock):
    """Monotonic seconds for everything that is waited for or aged; the date only for the record.

    A date that is set back, by hand or by the network, changes what stands in the record and nothing else.
    """

    def now(self) -> float:
        """Seconds since the machine was started."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait; less than nothing is nothing."""
        if seconds > 0:
            time.sleep(seconds)

    def utc(self) -> str:
        """Date and time by the machine's clock."""
        return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
