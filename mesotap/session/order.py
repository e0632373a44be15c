"""What a session is begun with: which rig, and the name of a folder that was given none."""

from __future__ import annotations

from dataclasses import dataclass

FOLDER_NAME = "%Y%m%d-%H%M%S"
"""Of a session that was given no other, by the time at which it began."""


@dataclass(frozen=True, slots=True)
class RigChoice:
    """Which rig a session is run with.

    Attributes
    ----------
    simulate, emulate
        The simulated rig, or the drivers on emulated devices, instead of the configured devices.
    seed
        Of the simulated rig; None for the configured one.
    realtime
        Whether simulated time passes as on the bench.
    speed
        How many times faster it then passes.
    """

    simulate: bool = False
    emulate: bool = False
    seed: int | None = None
    realtime: bool = False
    speed: float = 1.0

    @property
    def outlives(self) -> bool:
        """Whether the rig outlives a process that is killed, so that a guardian has to look after it."""
        return not self.simulate and not (self.emulate and not (self.realtime and self.speed == 1.0))
