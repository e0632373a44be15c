"""The wire between a driver and an emulated device: in this process, and with faults put on it if a test asks.

A device takes bytes and gives replies at once; what happens to them on the way is the disturbance's business. Time on
the wire is virtual: a reply that does not come costs its time-out in virtual seconds, and a sound one nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from rig import Clock
from rig.drivers.transport import Transport

ARRIVAL_S = 1e-4  # between two looks whether bytes have arrived
Delayed = tuple[float, bytes]  # delay, s, and bytes


class EmulatedDevice(Protocol):
    """A device at the end of a wire."""

    def receive(self, data: bytes) -> list[bytes]:
        """Take bytes in, in whatever pieces they come; returns the replies that are complete now."""

    def unasked(self) -> bytes:
        """Return what the device sends by itself since it was last asked for that."""


class Disturbance(Protocol):
    """What happens to bytes on their way."""

    plugged: bool
    """Whether the cable is in."""

    def request(self, data: bytes) -> bytes:
        """Return what arrives of bytes that the program sent."""

    def reply(self, data: bytes) -> list[Delayed]:
        """Return what arrives of a reply, and how much later."""


class Clean:
    """A wire without faults."""

    plugged = True

    def request(self, data: bytes) -> bytes:
        """Return the bytes as they are."""
        return data

    def reply(self, data: bytes) -> list[Delayed]:
        """Return the reply as it is, at once."""
        return [(0.0, data)]


class InProcessTransport(Transport):
    """A wire within this process: the same bytes as on a real one, at the cost of a function call.

    Parameters
    ----------
    device, port
        What the driver calls it.
    emulated
        The device at the other end.
    clock
        Virtual time.
    disturbance
        Faults; None for none.
    round_trip_s
        Time from a question to its reply, half of it on the way there: a USB adapter collects bytes for 16 ms, a
        controller thinks for 10.
    """

    def __init__(
        self,
        device: str,
        port: str,
        emulated: EmulatedDevice,
        clock: Clock,
        disturbance: Disturbance | None = None,
        round_trip_s: float = 0.0,
    ) -> None:
        super().__init__(device, port)
        self._emulated = emulated
        self._clock = clock
        self._disturbance: Disturbance = Clean() if disturbance is None else disturbance
        self._half_s = round_trip_s / 2
        self._going: list[tuple[float, bytes]] = []  # when it arrives, and what
        self._coming: list[tuple[float, bytes]] = []
        self._open = False

    def open(self) -> None:
        """Open the wire, unless its cable is out."""
        if not self._disturbance.plugged:
            raise self.gone("no such device")
        self._open = True

    def close(self) -> None:
        """Close the wire; what is under way is lost."""
        self._open = False
        self._going.clear()
        self._coming.clear()

    def write(self, data: bytes) -> None:
        """Let the device have ``data``, and its replies be on their way."""
        self._require_connection()
        self._going.append((self._clock.now() + self._half_s, data))
        self._arrive()

    def _arrive(self) -> None:
        """Let the device have what has arrived by now."""
        while self._going and self._going[0][0] <= self._clock.now():
            _, data = self._going.pop(0)
            for reply in self._emulated.receive(self._disturbance.request(data)):
                now = self._clock.now() + self._half_s
                self._coming += [(now + delay, part) for delay, part in self._disturbance.reply(reply)]

    def read(self, timeout_s: float) -> bytes:
        """Return what has come; time passes until then, or until it is too late."""
        self._require_connection()
        self._arrive()
        end = self._clock.now() + timeout_s
        while self._going and self._going[0][0] <= min([end, *(when for when, _ in self._coming)]):
            self._clock.sleep(self._going[0][0] - self._clock.now())
            self._arrive()
        timeout_s = max(0.0, end - self._clock.now()) if timeout_s > 0 else 0.0
        unasked = self._emulated.unasked()
        now = self._clock.now()
        if unasked:
            self._coming.insert(0, (now, unasked))
        if not self._coming:
            self._clock.sleep(timeout_s)
            return b""
        first = min(when for when, _ in self._coming)
        if first > now + timeout_s:
            self._clock.sleep(timeout_s)
            return b""
        self._clock.sleep(first - now)
        now = max(now, first)
        data = b"".join(part for when, part in self._coming if when <= now)
        self._coming = [(when, part) for when, part in self._coming if when > now]
        return data

    def _require_connection(self) -> None:
        if not self._disturbance.plugged:
            raise self.gone("device disconnected")
        if not self._open:
            raise self.gone("the port is closed")


class VirtualTimeTransport(Transport):
    """A transport over a real port, in virtual time: what does not come takes its time-out of virtual seconds.

    Parameters
    ----------
    inner
        The transport that moves the bytes.
    clock
        Virtual time.
    patience_s
        Real time that an emulated device, which answers at once, is given by a busy machine.
    taken
        How many bytes the device has taken so far: what is sent takes effect before virtual time goes on.
    """

    def __init__(self, inner: Transport, clock: Clock, patience_s: float, taken: Callable[[], int]) -> None:
        super().__init__(inner.device, inner.port)
        self._inner = inner
        self._clock = clock
        self._patience_s = patience_s
        self._taken = taken

    def open(self) -> None:
        """Open the port."""
        self._inner.open()

    def close(self) -> None:
        """Close the port."""
        self._inner.close()

    def write(self, data: bytes) -> None:
        """Send, and wait until it has arrived."""
        wanted = self._taken() + len(data)
        self._inner.write(data)
        end = time.monotonic() + self._patience_s
        while self._taken() < wanted and time.monotonic() < end:
            time.sleep(ARRIVAL_S)

    def read(self, timeout_s: float) -> bytes:
        """Return what has come."""
        if timeout_s <= 0:
            return self._inner.read(0.0)
        data = self._inner.read(self._patience_s)
        if not data:
            self._clock.sleep(timeout_s)
        return data
