"""A simulated person at a hand-turned micrometer: follows the prompts, not exactly."""

from __future__ import annotations

from collections.abc import Callable

from rig import Operator, Stage

OVERTURN = 1.05  # a hand turns a little further than it was told
FINEST_TURN_UM = 0.04


class SimulatedPerson(Operator):
    """Turns a stage when told to; says what it was told to someone who watches.

    Parameters
    ----------
    stage
        The simulated micrometer in the person's hand.
    audience
        Who is shown the prompts; None for nobody.
    """

    def __init__(self, stage: Stage, audience: Operator | None = None) -> None:
        self._stage = stage
        self._audience = audience

    def say(self, text: str) -> None:
        """Pass the sentence on."""
        if self._audience is not None:
            self._audience.say(text)

    def wait_ready(self, text: str) -> None:
        """Do it at once."""
        self.say(text)

    def turn(self, text: str, step_um: float, live: Callable[[], tuple[str, bool]]) -> None:
        """Turn in small turns, looking up after each; stop when the bell rings."""
        self.say(text)
        turned = 0.0
        while abs(turned) < abs(step_um) and not live()[1]:
            part = max(-1.0, min(1.0, step_um - turned)) if abs(step_um) <= 1.0 else (0.4 if step_um > 0 else -50.0)
            part = max(part, step_um - turned) if step_um < 0 else min(part, step_um - turned)
            if abs(part) < FINEST_TURN_UM:
                part = FINEST_TURN_UM if step_um > 0 else -FINEST_TURN_UM
            self._stage.move_by(part * OVERTURN)
            turned += part
