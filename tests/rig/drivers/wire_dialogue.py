"""A wire that follows a script: each request has to be the one that is next, and nothing may be left over."""

from __future__ import annotations

from rig.drivers.transport import Transport
from sim_backend.clock import VirtualClock
from sim_backend.emulators.modbus import crc16

SILENCE = b""


class Dialogue(Transport):
    """Pairs of sent and received; what is received may be nothing, or several pieces."""

    def __init__(self, *pairs: tuple[bytes, bytes | tuple[bytes, ...]]) -> None:
        super().__init__("a device", "/dev/ttyX")
        self.clock = VirtualClock()
        self._pairs = list(pairs)
        self._coming: list[bytes] = []
        self.is_open = False

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def write(self, data: bytes) -> None:
        assert self._pairs, f"{data!r} was sent, and nothing was to be"
        sent, received = self._pairs.pop(0)
        assert data == sent, f"{data!r} was sent where {sent!r} was to be"
        # an empty piece is silence until the time-out; no answer at all is not a piece
        self._coming += [received] * bool(received) if isinstance(received, bytes) else list(received)

    def read(self, timeout_s: float) -> bytes:
        if self._coming and (data := self._coming.pop(0)):
            return data
        self.clock.sleep(timeout_s)
        return b""

    def finished(self) -> None:
        assert not self._pairs, f"never sent: {[sent for sent, _ in self._pairs]}"


class Registers(Dialogue):
    """Holding registers at address 1, RTU: what is not among ``words`` is refused with exception 2."""

    def __init__(self, words: dict[int, int]) -> None:
        super().__init__()
        self.words = words

    def write(self, data: bytes) -> None:
        address, function, *numbers = data[:-2]
        assert (address, function) == (1, 3)
        offset, count = numbers[0] << 8 | numbers[1], numbers[2] << 8 | numbers[3]
        asked = range(offset, offset + count)
        if all(i in self.words for i in asked):
            octets = b"".join(self.words[i].to_bytes(2, "big") for i in asked)
            self._coming.append(rtu(1, 3, 2 * count, *octets))
        else:
            self._coming.append(rtu(1, 0x83, 2))


def rtu(*octets: int) -> bytes:
    """A frame with its check bytes."""
    return bytes(octets) + crc16(bytes(octets))


def lines(*pairs: tuple[str, str]) -> list[tuple[bytes, bytes]]:
    """Lines of a stage controller; an empty answer is none."""
    return [(f"{sent}\r\n".encode(), f"{got}\r\n".encode() if got else b"") for sent, got in pairs]
