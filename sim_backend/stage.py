"""Simulated motor micrometer: finite resolution, backlash, travel that takes time, a clamp."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from rig import RigError, Stage, StageReading
from sim_backend import settings as sections
from sim_backend.clock import VirtualClock

SETTLING_S = 0.02  # coming to rest after each move
CLAMPING_S = 0.1  # the clamp of a motor is the motor switched off
POLL_S = 0.01  # how often it is looked whether a move is over
DIGITS = 6  # of a position in um


@dataclass(frozen=True, slots=True)
class Motion:
    """A move of the knob: from where, to where, when it begins, when it has come to rest, how fast."""

    start_um: float
    target_um: float
    begun_s: float
    over_s: float
    speed_um_per_s: float


class SimulatedStage(Stage):
    """Knob and carriage with play between them.

    The reading is the knob's. Towards contact the knob pushes the carriage; away from it the play has to be used up
    before the carriage follows. ``moved`` is called after each move; what it asks of the stage is as it was just then,
    however the clock goes on meanwhile.
    """

    def __init__(self, settings: sections.SimulatedStage, clock: VirtualClock, moved: Callable[[], None]):
        self.step_um = settings.resolution_um
        self._settings = settings
        self._clock = clock
        self._moved = moved
        self._knob_um = 0.0
        self._carriage_um = 0.0
        self._locked = False
        self._motion: Motion | None = None
        self._telling = False

    @property
    def carriage_um(self) -> float:
        """Where the upper mass's spring is really held, um, towards contact."""
        self._keep_up()
        return self._carriage_um

    @property
    def knob_um(self) -> float:
        """Where the knob is now, um."""
        self._keep_up()
        return self._knob_um

    @property
    def moving(self) -> bool:
        """Whether a move is under way, its coming to rest included."""
        self._keep_up()
        return self._motion is not None

    @property
    def locked(self) -> bool:
        """Whether the clamp is closed."""
        return self._locked

    def read(self) -> StageReading:
        """Position of the knob now."""
        return StageReading(self._clock.now(), self.knob_um, self._locked)

    def move_by(self, step_um: float, aim: str = "") -> StageReading:
        """Move and come to rest; the end is rounded to the resolution."""
        if self._locked:
            raise RigError("The simulated stage is clamped: unlock it before it is moved.")
        if not math.isfinite(step_um):
            raise RigError(f"The simulated stage cannot move by {step_um} um: give a finite distance.")
        self._go_to(self.knob_um + step_um)
        return self.read()

    def advance(self, travel_um: float, step_um: float, stop: Callable[[], bool], aim: str = "") -> StageReading:
        """Step towards contact until told to stop or the travel is used up."""
        if not (step_um > 0 and travel_um >= 0 and math.isfinite(travel_um)):
            raise RigError(
                f"The simulated stage cannot advance {travel_um} um in steps of {step_um} um: both must be positive."
            )
        if self._locked:
            raise RigError("The simulated stage is clamped: unlock it before it is moved.")
        start = self.knob_um
        steps = math.ceil(travel_um / step_um - 1e-9)
        for i in range(1, steps + 1):
            if stop():
                return self.read()
            self._go_to(start + min(i * step_um, travel_um))
        stop()
        return self.read()

    def retract(self, travel_um: float, aim: str = "") -> StageReading:
        """Move back, clamped or not, faster than in other moves."""
        self.unlock()
        self._go_to(self.knob_um - travel_um, self._settings.speed_away_um_per_s)
        return self.read()

    def lock(self) -> None:
        """Close the clamp."""
        if not self._locked:
            self.clamp(True)
            self._clamping()

    def unlock(self) -> None:
        """Open the clamp."""
        if self._locked:
            self.clamp(False)
            self._clamping()

    def _clamping(self) -> None:
        """Wait until the clamp has closed or opened."""
        over = self._clock.now() + CLAMPING_S
        while self._clock.now() < over - POLL_S:
            self._clock.sleep_until(self._clock.now() + POLL_S)
            self.idle()
        self._clock.sleep_until(over)

    def clamp(self, closed: bool) -> None:
        """Have the clamp closed or open from now on."""
        self._locked = closed

    def begin(self, position_um: float, speed_um_per_s: float | None = None) -> float:
        """Begin to move to the multiple of the resolution next to ``position_um``; returns when it is over, s."""
        resolution = self._settings.resolution_um
        target = round(round(position_um / resolution) * resolution, DIGITS)
        self._keep_up()
        now = self._clock.now()
        speed = self._settings.speed_um_per_s if speed_um_per_s is None else speed_um_per_s
        travel_s = abs(target - self._knob_um) / speed
        self._motion = Motion(self._knob_um, target, now, now + (travel_s + SETTLING_S), speed)
        return self._motion.over_s

    def halt(self) -> None:
        """End a move where it is, at once."""
        self._keep_up()
        self._motion = None

    def _go_to(self, position_um: float, speed_um_per_s: float | None = None) -> None:
        if position_um > self.knob_um:
            self.permit()
        begun = self._clock.now()
        over = self.begin(position_um, speed_um_per_s)
        turns = 1
        while begun + turns * POLL_S < over:
            self._clock.sleep_until(begun + turns * POLL_S)
            self.idle()
            turns += 1
        self._clock.sleep_until(begun + turns * POLL_S)
        self._keep_up()

    def _keep_up(self) -> None:
        """Bring knob and carriage to where the move has come by now."""
        motion = self._motion
        if motion is None or self._telling:
            return
        now = self._clock.now()
        if now >= motion.over_s:
            self._motion = None
            knob = motion.target_um
        else:
            way = motion.target_um - motion.start_um
            gone = min(abs(way), motion.speed_um_per_s * (now - motion.begun_s))
            knob = motion.start_um + math.copysign(gone, way)
        if knob == self._knob_um:
            return
        self._knob_um = knob
        self._carriage_um = min(max(self._carriage_um, knob), knob + self._settings.backlash_um)
        self._telling = True
        try:
            self._moved()
        finally:
            self._telling = False

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""
        self._keep_up()
        motion = None if self._motion is None else asdict(self._motion)
        place = {"knob_um": self._knob_um, "carriage_um": self._carriage_um, "locked": self._locked}
        return place if motion is None else {**place, "motion": motion}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        self._knob_um, self._carriage_um = state["knob_um"], state["carriage_um"]
        self._locked = state["locked"]
        self._motion = Motion(**state["motion"]) if "motion" in state else None
