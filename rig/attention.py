"""What goes on whatever is waited for: the load is watched, the operator heeded, and somebody hears of it."""

from __future__ import annotations

from collections.abc import Callable

from rig.errors import RigError
from rig.interface import HEED_S, Rig, Waiting
from rig.watch import LoadWatch

SLOW_WIRE_S = 0.005  # round trip to the stage from which a step lasts longer than a look at the gauge
LOOK_S = 0.03  # which that takes, the wire apart
LONGEST_LOOK_S = 0.3  # with which load and recorder can be attended to in turn: its memory holds 0.4 s

Hold = Callable[[], bool]
"""Attends while the operator pauses; returns whether there may be a load, which is watched then."""


class Attention:
    """Attends to load, operator and guardian while parts wait.

    Parameters
    ----------
    rig
        Whose parts wait.
    watch
        Of its load.
    beat
        Called every time: the program lives.
    heed
        Called with what is to be done again and again while the operator pauses; raises what he wants to end with. It
        is called with None in the midst of a move or a reading, where he can end but a pause has to wait: a look at
        the load within which the program stood still would keep every other look from being made.

    Attributes
    ----------
    leaving
        Whether the rig is being brought into its safe state: from then on nothing interrupts.
    """

    def __init__(
        self, rig: Rig, watch: LoadWatch, beat: Callable[[], None], heed: Callable[[Hold | None], None]
    ) -> None:
        self._rig = rig
        self.watch = watch
        self._beat, self._heed = beat, heed
        self.leaving = False

    def attend(self, *others: Waiting) -> None:
        """Be called by the rig's parts, and by others, while they wait.

        A move is watched by the readings before and after it, and a reading is not a time to read: stage and gauge only
        heed.
        """
        for part in (self._rig.accelerometers, self._rig.weights, *others):
            part.idle = self.idle
        self._rig.stage.idle = self._rig.load_cell.idle = self.heed

    def watch_moves(self) -> None:
        """Have the load looked at in the midst of a move too where a slow wire makes it last.

        Raises
        ------
        RigError
            The wires are too slow to watch the load by.
        """
        stage, gauge = self._rig.stage, self._rig.load_cell
        look_s = LOOK_S + 2 * (gauge.round_trip_s + stage.round_trip_s)
        if look_s > LONGEST_LOOK_S:
            raise RigError(
                f"wires: a look at gauge and stage takes {look_s:.2f} s (replies of {gauge.round_trip_s * 1e3:.0f} and "
                f"{stage.round_trip_s * 1e3:.0f} ms), too long to watch the load by; set a higher baud rate, the USB "
                "adapter's latency to 1 ms, or connect them without a network in between"
            )
        if stage.round_trip_s > SLOW_WIRE_S:
            stage.idle, stage.idle_takes_s = self.idle, LOOK_S + 2 * gauge.round_trip_s

    def idle(self) -> None:
        """Attend to all of it."""
        self._beat()
        if not self.leaving:
            self.watch.look()
            self._heed(None if self.watch.looking else self.hold)

    def heed(self) -> None:
        """Heed a wish to end, without looking at the load; a pause waits until the move or reading is over."""
        self._beat()
        if not self.leaving:
            self._heed(None)

    def hold(self) -> bool:
        """Watch on while the operator pauses; on a rig whose time is virtual it has to be let pass."""
        self._beat()
        self.watch.look()
        self._rig.clock.sleep(HEED_S)
        return self.watch.needed
