"""Faults on a wire: what happens to requests and replies between a program and a device."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from enum import StrEnum

import numpy as np

from sim_backend.emulators.modbus import crc16

LATE_S = (0.12, 0.4)  # later than a driver waits
LATEST_CUT = 0.9  # share of a truncated reply that may still come


class WireFault(StrEnum):
    """What can happen to one exchange, or, the last two, to all of them until it is mended."""

    FLIPPED_REQUEST = "flipped request"
    FLIPPED_REPLY = "flipped reply"
    LATE = "late"
    TRUNCATED = "truncated"
    DUPLICATED = "duplicated"
    FOREIGN = "foreign"
    LOST = "lost"
    SILENT = "silent"
    PULLED = "pulled"


ONCE = tuple(fault for fault in WireFault if fault not in (WireFault.SILENT, WireFault.PULLED))


class DisturbedWire:
    """A wire on which faults are put.

    Parameters
    ----------
    foreign
        Makes a reply of another device out of a reply.
    seed
        Of which bit is flipped, how late a reply is, where it is cut.

    Attributes
    ----------
    plugged
        Whether the cable is in.
    requests
        How many requests went over the wire.
    """

    def __init__(self, foreign: Callable[[bytes], bytes], seed: int) -> None:
        self.plugged = True
        self.requests = 0
        self._silent = False
        self._foreign = foreign
        self._rng = np.random.default_rng([seed, 11])
        self._waiting: deque[WireFault] = deque()

    def inject(self, fault: WireFault | str) -> None:
        """Have a fault happen at the next exchange that it concerns, or from now on."""
        kind = WireFault(fault)
        if kind is WireFault.SILENT:
            self._silent = True
        elif kind is WireFault.PULLED:
            self.plugged = False
        else:
            self._waiting.append(kind)

    def mend(self) -> None:
        """Take all faults off the wire, and put the cable back."""
        self.plugged, self._silent = True, False
        self._waiting.clear()

    def request(self, data: bytes) -> bytes:
        """Return what arrives of a request."""
        self.requests += 1
        if self._waiting and self._waiting[0] is WireFault.FLIPPED_REQUEST:
            self._waiting.popleft()
            return self._flipped(data)
        return data

    def reply(self, data: bytes) -> list[tuple[float, bytes]]:
        """Return what arrives of a reply, and how much later."""
        if self._silent:
            return []
        if not self._waiting or self._waiting[0] is WireFault.FLIPPED_REQUEST:
            return [(0.0, data)]
        fault = self._waiting.popleft()
        if fault is WireFault.FLIPPED_REPLY:
            return [(0.0, self._flipped(data))]
        if fault is WireFault.LATE:
            return [(float(self._rng.uniform(*LATE_S)), data)]
        if fault is WireFault.TRUNCATED:
            return [(0.0, data[: int(self._rng.integers(0, max(1, int(LATEST_CUT * len(data)))))])]
        if fault is WireFault.DUPLICATED:
            return [(0.0, data), (0.0, data)]
        if fault is WireFault.FOREIGN:
            return [(0.0, self._foreign(data)), (0.0, data)]
        return []

    def _flipped(self, data: bytes) -> bytes:
        if not data:
            return data
        bit = int(self._rng.integers(0, 8 * len(data)))
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        return bytes(changed)


def foreign_rtu(reply: bytes) -> bytes:
    """Return the same reply from the next address, with its own check bytes."""
    other = bytes([reply[0] % 247 + 1]) + reply[1:-2]
    return other + crc16(other)


def foreign_tcp(reply: bytes) -> bytes:
    """Return the same reply with the number of another request."""
    return bytes([reply[0] ^ 0x40]) + reply[1:]


def foreign_line(reply: bytes) -> bytes:
    """Return the same line from the next controller on the bus."""
    digits = len(reply) - len(reply.lstrip(b"0123456789"))
    return b"%d" % (int(reply[:digits] or b"1") % 31 + 1) + reply[digits:]
