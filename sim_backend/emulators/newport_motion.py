"""What the emulated controller makes of the simulated micrometer: positions, steps, home, and moves that fail."""

from __future__ import annotations

import math
from typing import Any

from rig import Clock
from sim_backend import random_state
from sim_backend.emulators import newport_manual as manual
from sim_backend.emulators.newport_manual import Actuator
from sim_backend.stage import CLAMPING_S, DIGITS, SimulatedStage

FOLLOWING_S = 0.05
"""Until a motor that does not turn has fallen behind by the following error FE allowed. No source: assumed."""

RANDOM_ROLE = 21  # of where the actuator stands within its repeatability


class ControlledMotion:
    """Motion of the micrometer as the controller sees and makes it.

    Parameters
    ----------
    stage, clock
        The micrometer and its time.
    actuator
        Data of a real one; None for an ideal one.
    top_mm_per_s
        As fast as the motor turns.
    zero_mm
        True position at which the knob is at 0; the actuator's home, at the end of its travel, is position 0.
    seed
        Of where it stands within its repeatability.

    Attributes
    ----------
    stalled
        Whether the motor is held fast.
    fails_next
        Positioner error bits with which the next move fails.
    ends_um
        Where the actuator runs into its ends, knob.
    target_mm
        Where the last move was to end, or where the controller thinks that it stands.
    """

    def __init__(
        self,
        stage: SimulatedStage,
        clock: Clock,
        actuator: Actuator | None,
        top_mm_per_s: float,
        zero_mm: float,
        seed: int,
    ) -> None:
        self.stalled = False
        self.fails_next = 0
        travel_mm = actuator.travel_mm if actuator else math.inf
        self.ends_um = (-zero_mm * 1e3, (travel_mm - zero_mm) * 1e3)
        self._stage = stage
        self._clock = clock
        self._actuator = actuator
        self._top = top_mm_per_s
        self._home_um = -zero_mm * 1e3  # knob at the switch and the end that homes are found at
        self._rng = random_state.generator(seed, RANDOM_ROLE)
        self._switched_s = -CLAMPING_S
        self._fails_s: float | None = None
        self._why = 0
        self.forget()

    # --- positions --------------------------------------------------------------------------------------------

    def forget(self) -> None:
        """Stand still, and count from 0 where it stands: what is known after power-on."""
        self._stage.halt()
        self._stage.clamp(False)
        self._fails_s = None
        self._offset_mm = -self._stage.knob_um * 1e-3
        self.target_mm = 0.0

    def position_mm(self) -> float:
        """Return what the encoder says."""
        position = self._offset_mm + self._stage.knob_um * 1e-3
        if self._actuator is None:
            return position
        count = self._actuator.encoder_um * 1e-3
        return round(position / count) * count

    def set_point_mm(self) -> float:
        """Return where the motion profile is now."""
        return self.position_mm() if self.moving else self.target_mm

    @property
    def moving(self) -> bool:
        """Whether it is on its way, or is about to fail."""
        return self._stage.moving or self._fails_s is not None

    # --- moves ------------------------------------------------------------------------------------------------

    def begin(self, target_mm: float, speed_mm_per_s: float) -> None:
        """Begin to move to a position."""
        self.target_mm = target_mm
        knob = (target_mm - self._offset_mm) * 1e3
        if self._actuator is not None:
            step, either_way = self._actuator.step_um, self._actuator.repeatability_um
            knob = round(knob / step) * step + either_way * float(self._rng.uniform(-1, 1))
        self._turn(round(knob, DIGITS), speed_mm_per_s)

    def _turn(self, knob_um: float, speed_mm_per_s: float) -> None:
        low, high = self.ends_um
        reached = min(max(knob_um, low), high)
        if self.fails_next:
            self._fail_later(int(self.fails_next))
            self.fails_next = 0
        elif self.stalled or speed_mm_per_s > self._top:
            self._fail_later(manual.FOLLOWING)
        else:
            over = self._stage.begin(reached, speed_mm_per_s * 1e3)
            if reached != knob_um:
                end = manual.NEGATIVE_END if knob_um < low else manual.POSITIVE_END
                self._fails_s, self._why = over, end

    def _fail_later(self, bits: int) -> None:
        self._fails_s, self._why = self._clock.now() + FOLLOWING_S, bits

    def stop(self) -> None:
        """End a move where it is."""
        self._stage.halt()
        self._fails_s = None
        self.target_mm = self.position_mm()

    def failure(self) -> int:
        """Return the error bits of a move that has failed by now, once; 0 if none has."""
        if self.stalled and self._stage.moving:
            self._stage.halt()
            self._fail_later(manual.FOLLOWING)
        if self._fails_s is None or self._clock.now() < self._fails_s:
            return 0
        self.stop()
        return self._why

    # --- home -------------------------------------------------------------------------------------------------

    def search_home(self, kind: int, speed_mm_per_s: float, timeout_s: float) -> None:
        """Begin to look for the home, by the switches or where it stands."""
        self._stage.clamp(False)
        if kind == manual.CURRENT_POSITION:
            return
        self._turn(max(self._home_um, self.ends_um[0]), min(speed_mm_per_s, self._top))
        needed_s = abs(self._home_um - self._stage.knob_um) * 1e-3 / speed_mm_per_s
        if needed_s > timeout_s and self._fails_s is None:
            self._fails_s, self._why = self._clock.now() + timeout_s, manual.HOMING_TIMEOUT

    def find_home(self, kind: int) -> None:
        """Take as position 0 the true home, or for that kind of search where it stands, be that where it will."""
        home_um = self._stage.knob_um if kind == manual.CURRENT_POSITION else self._home_um
        self._offset_mm = -home_um * 1e-3
        self.target_mm = self.position_mm()

    # --- the motor --------------------------------------------------------------------------------------------

    def switch(self, on: bool, at_once: bool = False) -> None:
        """Switch the motor on or off."""
        self._stage.clamp(not on)
        self._switched_s = -CLAMPING_S if at_once else self._clock.now()

    @property
    def switching(self) -> bool:
        """Whether the motor is just being switched."""
        return self._clock.now() < self._switched_s + CLAMPING_S

    # --- checkpoint -------------------------------------------------------------------------------------------

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""
        return {
            "offset_mm": self._offset_mm,
            "target_mm": self.target_mm,
            "rng": random_state.state_of(self._rng),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        self._offset_mm, self.target_mm = state["offset_mm"], state["target_mm"]
        random_state.restore(self._rng, state["rng"])
        self._switched_s = -CLAMPING_S
        self._fails_s = None
