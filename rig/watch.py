"""The watch over the load: one period, whatever the session is waiting for.

Whoever waits (for a dwell, a tap, a person, a device that was unplugged) calls `LoadWatch.look` in between; it asks
the gauge and the stage when their time has come, and raises what the interlock has to say.
"""

from __future__ import annotations

import math

from rig.interface import Clock, Rig
from rig.interlock import Interlock

PERIOD_S = 0.1
"""Between two looks at the gauge: with what a silent gauge and a retraction take, half a second from the fault."""

SLOW_PERIOD_S, SLOW_S = 0.06, 0.005
"""The same where a reply takes longer than 5 ms: what a look costs there is gained by looking more often."""

LONGER_THAN_A_LOOK = 1.15
"""Times what a look takes, in which nobody looks again: else the recorder, which waits meanwhile, is never heard."""

STAGE_PERIOD_S = 0.15
"""Between two looks at the stage, which has to answer when it is needed."""

SHARE_OF_BUDGET = 0.2
"""Of the time for which a load may be unknown: no more of it may pass between two looks."""


class LoadWatch:
    """Looks at the load and at the stage while the surfaces may touch.

    Parameters
    ----------
    rig
        Opened rig.
    interlock
        What judges them.
    stale_s
        Longest time for which the load may be unknown.

    Attributes
    ----------
    taps
        Whether somebody may tap.
    """

    def __init__(self, rig: Rig, interlock: Interlock, stale_s: float) -> None:
        self._clock: Clock = rig.clock
        self._interlock = interlock
        self._gauge = rig.load_cell
        self._budget_s = SHARE_OF_BUDGET * stale_s
        self._gauge_seen_at = self._stage_seen_at = -math.inf
        self._looking = False
        self.taps = False

    @property
    def looking(self) -> bool:
        """Whether a look is being made, during which no other is."""
        return self._looking

    @property
    def needed(self) -> bool:
        """Whether the surfaces may touch: where they do not, there is no load to watch."""
        return self._interlock.contact is not None

    def restart(self) -> None:
        """Count the periods from now on: with each entry of the journal, so that a resumed session looks alike."""
        self._gauge_seen_at = self._stage_seen_at = self._clock.now()

    def look(self) -> None:
        """Look at what is due; nothing while the surfaces are apart.

        Raises
        ------
        StaleReading
            The gauge is silent, frozen or senseless.
        InterlockRefusal
            The load is over the limit, or the stage moved by itself.
        RigError
            The stage does not answer.
        """
        if self._looking or not self.needed:
            return
        self._looking = True  # a part that waits while it is looked at calls this again
        try:
            slow_s = self._gauge.round_trip_s
            period_s = max(SLOW_PERIOD_S, LONGER_THAN_A_LOOK * slow_s) if slow_s > SLOW_S else PERIOD_S
            if self._clock.now() - self._gauge_seen_at >= min(period_s, self._budget_s):
                self._gauge_seen_at = self._clock.now()
                self._interlock.look_at_gauge(self.taps)
            if self._clock.now() - self._stage_seen_at >= STAGE_PERIOD_S:
                self._stage_seen_at = self._clock.now()
                self._interlock.look_at_stage()
        finally:
            self._looking = False
