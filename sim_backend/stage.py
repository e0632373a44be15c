"""Simulated motor micrometer: finite resolution, backlash, travel that takes time, a clamp."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rig import RigError, Stage, StageReading
from sim_backend import settings as sections
from sim_backend.clock import VirtualClock

SETTLING_S = 0.02  # coming to rest after each move
CLAMPING_S = 0.5


class SimulatedStage(Stage):
    """Knob and carriage with play between them.

    The reading is the knob's. Towards contact the knob pushes the carriage; away from it the play has to be used up
    before the carriage follows. ``moved`` is called after each move.
    """

    def __init__(self, settings: sections.SimulatedStage, clock: VirtualClock, moved: Callable[[], None]):
        self._settings = settings
        self._clock = clock
        self._moved = moved
        self._knob_um = 0.0
        self._carriage_um = 0.0
        self._locked = False

    @property
    def carriage_um(self) -> float:
        """Where the upper mass's spring is really held, um, towards contact."""
        return self._carriage_um

    @property
    def locked(self) -> bool:
        """Whether the clamp is closed."""
        return self._locked

    def read(self) -> StageReading:
        """Position of the knob now."""
        return StageReading(self._clock.now(), self._knob_um, self._locked)

    def move_by(self, step_um: float, aim: str = "") -> StageReading:
        """Move and come to rest; the end is rounded to the resolution."""
        if self._locked:
            raise RigError("The simulated stage is clamped: unlock it before it is moved.")
        if not math.isfinite(step_um):
            raise RigError(f"The simulated stage cannot move by {step_um} um: give a finite distance.")
        self._go_to(self._knob_um + step_um)
        return self.read()

    def advance(self, travel_um: float, step_um: float, stop: Callable[[], bool], aim: str = "") -> StageReading:
        """Step towards contact until told to stop or the travel is used up."""
        if not (step_um > 0 and travel_um >= 0 and math.isfinite(travel_um)):
            raise RigError(
                f"The simulated stage cannot advance {travel_um} um in steps of {step_um} um: both must be positive."
            )
        if self._locked:
            raise RigError("The simulated stage is clamped: unlock it before it is moved.")
        start = self._knob_um
        steps = math.ceil(travel_um / step_um - 1e-9)
        for i in range(1, steps + 1):
            if stop():
                return self.read()
            self._go_to(start + min(i * step_um, travel_um))
        stop()
        return self.read()

    def lock(self) -> None:
        """Close the clamp."""
        if not self._locked:
            self._locked = True
            self._clock.sleep(CLAMPING_S)

    def unlock(self) -> None:
        """Open the clamp."""
        if self._locked:
            self._locked = False
            self._clock.sleep(CLAMPING_S)

    def _go_to(self, position_um: float) -> None:
        resolution = self._settings.resolution_um
        target = round(position_um / resolution) * resolution
        self._clock.sleep(abs(target - self._knob_um) / self._settings.speed_um_per_s + SETTLING_S)
        self._knob_um = target
        self._carriage_um = min(max(self._carriage_um, target), target + self._settings.backlash_um)
        self._moved()

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""
        return {"knob_um": self._knob_um, "carriage_um": self._carriage_um, "locked": self._locked}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        self._knob_um, self._carriage_um = state["knob_um"], state["carriage_um"]
        self._locked = state["locked"]
