"""What a tester is: the abstract `Rig` and its parts.

A part is an interface; motor or hand-turned micrometer, solenoid or finger, real or simulated are
implementations of it. Code above this package cannot tell which one it drives.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from rig.readings import Block, LoadReading, StageReading

HEED_S = 0.02
"""Longest time that anything waits, with nobody talking on a wire, without hearing that it is to end: STOP has to be on
the wire within 0.1 s, and the looks at gauge and stage that may come first take up to 0.05."""


def nothing() -> None:
    """Do nothing: what is done while a part waits, unless somebody asks for more."""


class Waiting:
    """Whatever may wait long: for a person, a tap, a device that was unplugged.

    Attributes
    ----------
    idle
        Called several times a second while it waits; what it raises ends the waiting. The session runner watches the
        load with it and heeds the operator's wish to end; a stage that moves and a gauge that is read only heed.
    """

    idle: Callable[[], None] = staticmethod(nothing)


class Clock(ABC):
    """Time as the rig sees it. A simulated rig passes virtual time."""

    @abstractmethod
    def now(self) -> float:
        """Seconds since an arbitrary origin; never runs backwards."""

    @abstractmethod
    def sleep(self, seconds: float) -> None:
        """Let time pass."""

    @abstractmethod
    def utc(self) -> str:
        """Date and time, ISO 8601 UTC with milliseconds and a trailing ``Z``."""


class Operator(Waiting, ABC):
    """The person at the bench: told things, asked to do things. A terminal, or a script in tests."""

    @abstractmethod
    def say(self, text: str) -> None:
        """Show one sentence."""

    @abstractmethod
    def wait_ready(self, text: str) -> None:
        """Show what to do and return once the person says that it is done."""

    @abstractmethod
    def turn(self, text: str, step_um: float, live: Callable[[], tuple[str, bool]]) -> None:
        """Show what to turn (``step_um``, positive towards contact) and keep showing ``live()[0]`` meanwhile.

        While ``live()[1]`` is true, ring: stop turning. Returns once the person says that the turning is done.
        """


class LoadCell(Waiting, ABC):
    """Strain-gauge bridge and its amplifier.

    Attributes
    ----------
    name
        What it is called in errors; a driver adds where it is connected.
    round_trip_s
        Longest time from a question to its reply seen so far, s; 0 where no wire is in between.
    settling_s
        In which it has followed a step of the load but for a third, by its amplifier's filter, s; 0 where that is
        shorter than any reading.
    """

    name: str = "strain gauge"
    round_trip_s: float = 0.0
    settling_s: float = 0.0

    @abstractmethod
    def read(self, duration_s: float = 0.1) -> LoadReading:
        """Average the bridge voltage over ``duration_s``; raises `RigError` when the gauge does not answer."""


class Stage(Waiting, ABC):
    """Micrometer that carries the upper mass. Positive moves go towards contact.

    Attributes
    ----------
    permit
        Called just before the stage is told to move towards contact; what it raises keeps it from moving. The
        interlock sees with it that the load is still known after whatever went on in between.
    round_trip_s
        Longest time from a question to its reply seen when it was connected, s.
    step_um
        Positions are whole multiples of this; 0 where any position can be had, or nobody knows.
    idle_takes_s
        How long one call of `idle` may take in the midst of a move, s: so much later is it looked where the stage is.
    """

    idle_takes_s: float = 0.0

    permit: Callable[[], None] = staticmethod(nothing)
    round_trip_s: float = 0.0
    step_um: float = 0.0

    @abstractmethod
    def read(self) -> StageReading:
        """Position now."""

    @abstractmethod
    def move_by(self, step_um: float, aim: str = "") -> StageReading:
        """Move by ``step_um`` (positive: towards contact) and return when at rest; `RigError` if locked.

        ``aim`` says in words what the move is for; a hand-turned stage shows it.
        """

    @abstractmethod
    def advance(self, travel_um: float, step_um: float, stop: Callable[[], bool], aim: str = "") -> StageReading:
        """Move towards contact in steps of at most ``step_um`` until ``stop()`` or ``travel_um`` is used up.

        ``stop`` is called before the first step and after each one; what it raises ends the move.
        """

    def retract(self, travel_um: float, aim: str = "") -> StageReading:
        """Take the surfaces apart by ``travel_um``, clamped or not, as soon as can be; return when at rest."""
        self.unlock()
        return self.move_by(-travel_um, aim)

    @abstractmethod
    def lock(self) -> None:
        """Clamp the stage, which takes the micrometer out of the dynamics (Sec. 3.3)."""

    @abstractmethod
    def unlock(self) -> None:
        """Release the clamp."""


class Accelerometers(Waiting, ABC):
    """The two accelerometers of the lower mass and the recorder behind them, streaming continuously."""

    sample_rate_hz: float
    full_scale_m_s2: float
    bits: int

    @abstractmethod
    def start(self) -> None:
        """Begin to stream; sample 0 is the first one after this call."""

    @abstractmethod
    def read_block(self) -> Block:
        """Return the next block, waiting for it; `RigError` on overrun or silence."""

    @abstractmethod
    def stop(self) -> None:
        """End the stream; harmless when it does not run."""


class Impactor(ABC):
    """Whatever taps the upper mass."""

    @abstractmethod
    def tap(self, load_mn: float, hint: str = "") -> None:
        """Have one tap made soon after this call, fit for a preload of ``load_mn``.

        ``hint`` is what was wrong with the tap before (empty if nothing was).
        """

    def release(self) -> None:  # noqa: B027 - a finger needs no switching off
        """Take the current off whatever taps; harmless at any time."""


class DeadWeights(Waiting, ABC):
    """Calibration weights hung on the load cell, with the surfaces apart."""

    @abstractmethod
    def place(self, load_mn: float) -> None:
        """Return once exactly this load hangs on the gauge and it has come to rest; 0 removes all."""


class Rig(ABC):
    """A tester: its parts, its clock, and how to open and leave it."""

    name: str
    clock: Clock
    load_cell: LoadCell
    stage: Stage
    accelerometers: Accelerometers
    impactor: Impactor
    weights: DeadWeights

    @abstractmethod
    def open(self) -> list[str]:
        """Connect to every part; a line for each saying what answered. `RigError` names each that did not."""

    @abstractmethod
    def close(self) -> None:
        """Let go of every part; harmless when called twice."""

    def checkpoint(self) -> dict[str, Any]:
        """State worth keeping with each entry of the journal, as JSON types.

        Hardware keeps its own state while a program is down and returns what it read last; a simulated rig
        returns all it is.
        """
        return {}

    def restore(self, state: dict[str, Any]) -> None:  # noqa: B027 - hardware has nothing to restore
        """Take up the state of `checkpoint`; hardware, which kept it, ignores it."""
