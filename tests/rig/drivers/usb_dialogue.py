"""A USB device that follows a script: each transfer has to be the one that is next, and nothing may be left over."""

from __future__ import annotations

import struct

from sim_backend.emulators.usb_bus import UsbBus


def out(request: int, value: int = 0, data: bytes = b"") -> tuple:
    """A request to the device, which takes it."""
    return ("out", request, value, data), None


def ask(request: int, answer: bytes | Exception, value: int = 0, length: int | None = None) -> tuple:
    """A request for an answer."""
    return ("in", request, value, len(answer) if length is None else length), answer


def bulk(answer: bytes | Exception, length: int | None = None) -> tuple:
    """A bulk transfer."""
    return ("bulk", len(answer) if length is None else length), answer


CLEAR_HALT = (("clear halt",), None)
STATUS, SERIAL, CALIBRATION = 0x44, 0x48, 0x30
RUNNING, OVERRUN = b"\x02\x00", b"\x04\x00"


def connecting(
    slope: float = 1.0, intercept: float = 0.0, inputs: tuple[tuple[int, int], ...] = ((1, 0), (1, 1), (5, 2))
):
    """Find it, stop what may run, read the calibration of each (range, input)."""
    line = struct.pack("<ff", slope, intercept)
    return [ask(SERIAL, b"01D2E3F4"), out(0x12), *(ask(CALIBRATION, line, (r * 8 + i) * 8) for r, i in inputs)]


def starting(pacer: int = 1599, mask: int = 0b111, ranges: bytes = bytes([1, 1, 5, 0, 0, 0, 0, 0])):
    """Stop, clear, set ranges, start."""
    return [out(0x12), out(0x15), out(0x14, data=ranges), out(0x11, data=struct.pack("<IIBB", 0, pacer, mask, 0))]


class Scripted:
    """The device."""

    vendor, product, endpoint, packet = 0x09DB, 0x00EA, 0x81, 64

    def __init__(self, *pairs: tuple | list) -> None:
        self.pairs = [pair for part in pairs for pair in (part if isinstance(part, list) else [part])]
        self.bus = UsbBus(self)

    def _next(self, sent: tuple):
        assert self.pairs, f"more was sent than expected: {sent}"
        expected, answer = self.pairs.pop(0)
        assert sent == expected
        if isinstance(answer, Exception):
            raise answer
        return answer

    def control_out(self, request: int, value: int, data: bytes, timeout_s: float) -> None:
        self._next(("out", request, value, data))

    def control_in(self, request: int, value: int, length: int, timeout_s: float) -> bytes:
        return self._next(("in", request, value, length))

    def bulk_in(self, length: int, timeout_s: float) -> bytes:
        return self._next(("bulk", length))

    def clear_halt(self) -> None:
        self._next(("clear halt",))

    def look(self) -> None:
        pass

    def power_up(self) -> None:
        pass
