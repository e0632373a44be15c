"""What every driver of a device can do besides being a part of the rig."""

from __future__ import annotations

from abc import ABC, abstractmethod


class Driver(ABC):
    """A device that is connected and let go of."""

    @abstractmethod
    def connect(self) -> str:
        """Connect and make sure that it is the device expected; a line saying what answered. `RigError` if not.

        Nothing moves but a stage that has to find its reference and was allowed to.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of the device; harmless when called twice."""
