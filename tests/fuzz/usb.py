"""Whatever a USB device answers, the driver says one sentence or delivers whole blocks in order."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
from usb.core import USBError

from rig import RigError
from rig.drivers.recorder_settings import Usb1608Settings
from rig.drivers.usb1608 import Usb1608
from rig.settings import Wiring
from sim_backend.clock import VirtualClock
from sim_backend.emulators.usb_bus import UsbBus, gone, overflowed, stalled, timed_out
from tests.fuzz.source import Source, Target

Answer = bytes | Callable[[], USBError] | None

ERRORS = (stalled, timed_out, gone, overflowed, lambda: USBError("Other", -99, None), lambda: USBError("?", 0, 5))
PLAUSIBLE = (b"01D2E3F4", struct.pack("<ff", 1.0, 0.0), b"\x02\x00", b"\x04\x00", b"\x00")


def answer(source: Source) -> Answer:
    """What a device may answer a request: None is what would be right."""
    kind = source.integer(0, 3)
    return (None, source.choice(PLAUSIBLE), source.content(12), source.choice(ERRORS))[kind]


def transfer(source: Source) -> Answer:
    """What a device may deliver."""
    kind = source.integer(0, 3)
    if kind == 2:
        return bytes(source.integer(0, 1600))
    return (None, source.content(300), None, source.choice(ERRORS))[kind]


class Babbling:
    """A device that answers what it likes: None is what would be right."""

    vendor, product, endpoint, packet = 0x09DB, 0x00EA, 0x81, 64

    def __init__(self, replies: list, blocks: list) -> None:
        self.replies, self.blocks = iter(replies), iter(blocks)
        self.clock = VirtualClock()

    def control_out(self, request: int, value: int, data: bytes, timeout_s: float) -> None:
        self._next(self.replies, b"")

    def control_in(self, request: int, value: int, length: int, timeout_s: float) -> bytes:
        right = {0x48: b"01D2E3F4", 0x30: struct.pack("<ff", 1.0, 0.0), 0x44: b"\x02\x00"}
        return self._next(self.replies, right.get(request, b"\0"))[:length]

    def bulk_in(self, length: int, timeout_s: float) -> bytes:
        self.clock.sleep(0.01)
        return self._next(self.blocks, bytes(length))[:length]

    def _next(self, source, right: bytes) -> bytes:
        answer = next(source, None)
        if callable(answer):
            self.clock.sleep(0.1)
            raise answer()
        return right if answer is None else answer

    def clear_halt(self) -> None:
        self._next(self.replies, b"")

    def look(self) -> None:
        pass

    def power_up(self) -> None:
        pass


def any_answers(place: Path) -> Target:
    def check(drawn: tuple[list[Answer], list[Answer]]) -> None:
        replies, blocks = drawn
        device = Babbling(replies, blocks)
        bus = UsbBus(device)
        driver = Usb1608(Wiring(), Usb1608Settings(), device.clock, bus)
        due = 0
        begin = device.clock.now()
        try:
            driver.connect()
            driver.start()
            for _ in range(4):
                block = driver.read_block()
                assert block.acceleration.shape == (2, 256)
                assert block.strain_mv is not None
                assert np.isfinite(block.acceleration).all()
                assert np.isfinite(block.strain_mv).all()
                assert block.first_sample >= due
                due = block.first_sample + 256
        except RigError as error:
            assert str(error)
            assert "\n" not in str(error)
        driver.close()
        assert bus.opened == 0
        assert device.clock.now() - begin < 60.0

    return Target(lambda source: (source.several(answer, 0, 25), source.several(transfer, 0, 25)), check)


TARGETS = (any_answers,)
