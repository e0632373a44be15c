"""Parts that are a person's hands: the micrometer that is turned, the finger that taps, the weights that are hung.

The paper's own tester is driven so (Sec. 3.3). The session runner cannot tell these from a motor: it asks for
a move, and a hand-turned stage says what to turn, shows the load live and waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from rig.errors import RigError
from rig.interface import Clock, DeadWeights, Impactor, Operator, Stage
from rig.readings import StageReading
from rig.settling import rest


class HandStage(Stage):
    """Micrometer turned and clamped by hand; it has no encoder, so its position is not known.

    Parameters
    ----------
    operator
        Who turns.
    clock
        Rig time.
    live_load
        Sentence with the load at this moment, shown while the person turns.
    """

    def __init__(self, operator: Operator, clock: Clock, live_load: Callable[[], str]) -> None:
        self._operator = operator
        self._clock = clock
        self._live_load = live_load
        self._locked = False

    def read(self) -> StageReading:
        """Time and clamp; the position is NaN."""
        return StageReading(self._clock.now(), math.nan, self._locked)

    def move_by(self, step_um: float, aim: str = "") -> StageReading:
        """Ask for one turn and wait until it is done."""
        self._require_unlocked()
        direction = "towards contact" if step_um > 0 else "away from contact"
        text = f"Turn the micrometer {abs(step_um):.3g} um {direction}{f' ({aim})' if aim else ''}."
        self._operator.turn(text, step_um, lambda: (self._live_load(), False))
        return self.read()

    def advance(self, travel_um: float, step_um: float, stop: Callable[[], bool], aim: str = "") -> StageReading:
        """Ask to turn slowly towards contact; ring as soon as ``stop()`` is true."""
        self._require_unlocked()
        if stop():
            return self.read()
        text = f"Turn the micrometer slowly towards contact, at most {step_um:.2g} um at a time"
        text += f" ({aim})." if aim else "."
        self._operator.turn(text, travel_um, lambda: (self._live_load(), stop()))
        return self.read()

    def lock(self) -> None:
        """Ask to clamp the micrometer and wait for the person's word."""
        self._operator.wait_ready("Clamp the micrometer, without moving it.")
        self._locked = True

    def unlock(self) -> None:
        """Ask to open the clamp and wait for the person's word."""
        if self._locked:
            self._operator.wait_ready("Open the micrometer's clamp.")
            self._locked = False

    def _require_unlocked(self) -> None:
        if self._locked:
            raise RigError("micrometer: it is clamped; open the clamp before it is turned")


class HandImpactor(Impactor):
    """A person with the small impactor."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator

    def tap(self, load_mn: float, hint: str = "") -> None:
        """Ask for one tap."""
        about_the_last = f" The last one was not used: {hint}." if hint else ""
        self._operator.say(f"Tap the upper mass once, lightly (preload {load_mn:.0f} mN).{about_the_last}")


class HandWeights(DeadWeights):
    """Weights hung by a person."""

    def __init__(self, operator: Operator, clock: Clock, settle_s: float = 2.0) -> None:
        self._operator = operator
        self._clock = clock
        self._settle_s = settle_s

    def place(self, load_mn: float) -> None:
        """Ask for a weight and give it time to come to rest."""
        self._operator.wait_ready(
            f"Hang {load_mn:g} mN on the gauge." if load_mn else "Take all weights off the gauge."
        )
        rest(self._clock, self._settle_s, self.idle)  # whoever wants to end need not wait for it
