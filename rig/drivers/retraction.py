"""How a retraction goes: whether the stage arrives, is stuck, or has to be told once more."""

from __future__ import annotations

from rig.drivers.newport_codes import AxisState
from rig.drivers.settings import NewportStage
from rig.interface import Clock

STUCK_S = 2.0  # without a step back, after which it counts as stuck
LONGER, PATIENCE_S = 2.0, 1.0  # times the time that a motion should take, and more, after which it counts as too slow
JUDGED_AFTER_S, SLOWEST = 0.1, 0.25
"""When the speed is looked at first, besides two round trips, and the share of the one ordered below which the order
for it got lost: an actuator of 1.6 mm/s2 is at 0.2 mm/s after 0.13 s."""
UNDER_WAY = (AxisState.MOVING, AxisState.HOMING)


class Retraction:
    """What was seen of one retraction.

    Parameters
    ----------
    settings
        Of the stage.
    clock
        Rig time.
    start_um, target_um
        From where, to where.
    round_trip_s
        Of its wire.
    """

    def __init__(
        self, settings: NewportStage, clock: Clock, start_um: float, target_um: float, round_trip_s: float
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._start_um = self._furthest_um = start_um
        self._target_um = target_um
        self._doubt_s = 2 * round_trip_s  # by which the time of a position may be wrong
        self._lasts_s = LONGER * abs(start_um - target_um) / settings.speed_um_per_s + PATIENCE_S
        self._moved_s = clock.now()
        self._again_s = self._moved_s + self._lasts_s
        self._seen: tuple[float, float] | None = None  # when and where it was under way first
        self._judged = False

    def stuck(self) -> bool:
        """Whether it has not moved back for long."""
        return self._clock.now() >= self._moved_s + STUCK_S

    def arrived(self, state: AxisState, here_um: float) -> bool:
        """Whether it stands where it was sent."""
        return state is AxisState.READY and abs(here_um - self._target_um) <= self._settings.in_position_um

    def again(self, state: AxisState, here_um: float) -> bool:
        """Whether it has to be told once more, as it stands, goes the wrong way or crawls: an order was damaged."""
        now = self._clock.now()
        if here_um < self._furthest_um - self._settings.resolution_um:
            self._furthest_um, self._moved_s = here_um, now
        if state not in UNDER_WAY:
            return True
        late = now >= self._again_s
        if late:
            self._again_s = now + self._lasts_s
        return late or here_um > self._start_um + self._settings.in_position_um or self._crawls(now, here_um)

    def _crawls(self, now: float, here_um: float) -> bool:
        """Whether it goes far slower than told; said once, for a motor may be slower than it is said to be."""
        if self._seen is None:
            self._seen = (now, here_um)
        lasted = now - self._seen[0] - self._doubt_s
        if self._judged or lasted < JUDGED_AFTER_S:
            return False
        self._judged = True
        return self._seen[1] - here_um < SLOWEST * self._settings.speed_um_per_s * lasted
