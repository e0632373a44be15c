"""Requests of the MCC USB-1608FS-Plus: eight 16-bit inputs sampled together, paced by the device's own clock.

Sources: the maker's library uldaq (``AiUsb1608fsPlus.cpp``, ``Usb1608fsPlus.cpp``), W. Jasper's Linux drivers
(``usb-1608FS-Plus.c`` and ``.h``), the maker's user's guide (ranges: p. 11). Two requests are left out on purpose: 0x50
erases the program memory, and writing 0x30 the calibration.
"""

from __future__ import annotations

import array
import contextlib
import math
import struct
from enum import IntEnum, IntFlag

from usb.backend import IBackend

from rig.drivers.usb_transport import UsbStalled, UsbTransport, connected
from rig.errors import RigError

VENDOR, PRODUCT = 0x09DB, 0x00EA
NAME = "MCC USB-1608FS-Plus"
DEVICE = f"recorder {NAME}"

ENDPOINT = 0x81
PACKET = 64
"""Bytes of every packet of a continuous scan in block transfer: one that is not full has lost some."""

BASE_CLOCK_HZ = 40e6
HIGHEST_RATE_HZ = 100e3
CHANNELS = 8
BITS = 16
RANGE_CODES = {10.0: 0, 5.0: 1, 2.0: 3, 1.0: 5}
"""Ranges, plus and minus volts, and their codes: those sold, by the user's guide p. 11, DAQFlex specification p. 30,
uldaq (``mapRangeCode`` refuses others) and Jasper's C driver. The codes between are in one Python driver alone."""

LARGEST_SLOPE_ERROR = 0.2
LARGEST_INTERCEPT = 4096.0
"""Calibrations beyond these (codes) are no calibrations: the factory's stay within a few percent."""


class NoRecorder(RigError):
    """There is no such device on the bus."""


class Request(IntEnum):
    """bRequest of what this driver sends."""

    TRISTATE = 0x00
    LATCH = 0x02
    SCAN_START = 0x11
    SCAN_STOP = 0x12
    SCAN_RANGES = 0x14
    CLEAR_FIFO = 0x15
    CALIBRATION = 0x30
    STATUS = 0x44  # written, it clears the errors: Jasper's C driver, usbStatus_USB1608FS_Plus
    SERIAL_NUMBER = 0x48


class Status(IntFlag):
    """Bits of the status word."""

    RUNNING = 1 << 1
    OVERRUN = 1 << 2


def pacer_of(rate_hz: float) -> int:
    """Return the period of the pacer nearest to a sampling rate, in ticks of 40 MHz less one.

    Raises
    ------
    RigError
        The device cannot sample so fast or so slowly.
    """
    ticks = round(BASE_CLOCK_HZ / rate_hz) - 1 if rate_hz > 0 and math.isfinite(rate_hz) else 0
    if not 0 < ticks < 2**32 or rate_hz > HIGHEST_RATE_HZ:
        raise RigError(
            f"rig.wiring.sample_rate_hz: {rate_hz:g} Hz is not possible with the {NAME}, at most {HIGHEST_RATE_HZ:g}"
        )
    return ticks


def rate_of(pacer: int) -> float:
    """Return the sampling rate of a pacer period, Hz."""
    return BASE_CLOCK_HZ / (pacer + 1)


class Usb1608Protocol:
    """The device's requests, each checked for the form of its answer.

    Parameters
    ----------
    transport
        Opened.
    """

    def __init__(self, transport: UsbTransport) -> None:
        self.transport = transport

    def serial_number(self) -> str:
        """Return the eight characters on the device's label."""
        answer = self.transport.ask(Request.SERIAL_NUMBER, 8)
        text = answer.decode("ascii", "replace").rstrip("\0 ")
        if len(answer) != 8 or not (text.isascii() and text.isalnum()):
            raise self.transport.damaged(f"its serial number reads {answer!r}")
        return text

    def calibration(self, range_v: float, channel: int) -> tuple[float, float]:
        """Return slope and intercept, in codes, of one input at one range."""
        address = (RANGE_CODES[range_v] * CHANNELS + channel) * 8
        answer = self.transport.ask(Request.CALIBRATION, 8, address)
        if len(answer) != 8:
            raise self.transport.damaged(f"its calibration memory gave {len(answer)} of 8 bytes")
        slope, intercept = struct.unpack("<ff", answer)
        # written so that a NaN is refused too
        if not (abs(slope - 1) <= LARGEST_SLOPE_ERROR and abs(intercept) <= LARGEST_INTERCEPT):
            raise self.transport.unusable(
                f"the calibration of input {channel} at {range_v:g} V is slope {slope:g}, "
                f"intercept {intercept:g}, which cannot be",
                "have it calibrated",
            )
        return slope, intercept

    def status(self) -> Status:
        """Return whether a scan runs and whether it was overrun."""
        answer = self.transport.ask(Request.STATUS, 2)
        if not answer:
            raise self.transport.damaged("its status is empty")
        return Status(int.from_bytes(answer, "little") & (Status.RUNNING | Status.OVERRUN))

    def set_ranges(self, codes: list[int]) -> None:
        """Set the range of each of the eight inputs; refused by the device while a scan runs."""
        self.transport.send(Request.SCAN_RANGES, data=bytes(codes))

    def start_scan(self, pacer: int, mask: int) -> None:
        """Start a continuous scan of the inputs in ``mask``, in block transfer, stalling on an overrun."""
        self.transport.send(Request.SCAN_START, data=struct.pack("<IIBB", 0, pacer, mask, 0))

    def stop_scan(self) -> None:
        """Stop the scan, if one runs."""
        self.transport.send(Request.SCAN_STOP)

    def clear_fifo(self) -> None:
        """Forget what was sampled and not read."""
        self.transport.send(Request.CLEAR_FIFO)

    def clear_errors(self) -> None:
        """Have the status forget an overrun; a device that does not know of this forgets it with the next scan."""
        with contextlib.suppress(UsbStalled):
            self.transport.send(Request.STATUS)

    def clear_halt(self) -> None:
        """Take the data endpoint back into use after a stall."""
        self.transport.clear_halt(ENDPOINT)

    def read_into(self, buffer: array.array[int], timeout_s: float) -> int:
        """Read samples until ``buffer`` is full, or less when a short packet comes; returns the bytes read.

        Raises
        ------
        UsbDamaged
            The bytes are not whole packets, so that what follows cannot be told apart into inputs.
        """
        count = self.transport.read_into(ENDPOINT, buffer, timeout_s)
        if count % PACKET:
            raise self.transport.damaged(f"it sent {count} bytes, not whole packets of {PACKET}", "check its cable")
        return count

    def make_output(self, bit: int) -> None:
        """Drive one digital line, low at first; the others stay as they are."""
        self.set_line(bit, False)
        inputs = self._register(Request.TRISTATE)
        self.transport.send(Request.TRISTATE, inputs & ~(1 << bit) & 0xFF)

    def set_line(self, bit: int, high: bool) -> None:
        """Set one digital line; the others stay as they are."""
        latch = self._register(Request.LATCH)
        self.transport.send(Request.LATCH, latch | 1 << bit if high else latch & ~(1 << bit) & 0xFF)

    def _register(self, request: Request) -> int:
        answer = self.transport.ask(request, 1)
        if len(answer) != 1:
            raise self.transport.damaged(f"register 0x{request:02X} gave {len(answer)} of 1 byte")
        return answer[0]


def find(serial_number: str | None, backend: IBackend | None = None) -> tuple[Usb1608Protocol, str]:
    """Open the recorder with this serial number, or the only one; returns it and its number.

    Raises
    ------
    RigError
        There is none, there are several and none was named, or only others answer.
    """
    devices = connected(VENDOR, PRODUCT, backend, DEVICE)
    if not devices:
        raise NoRecorder(f"{DEVICE}: there is none on USB; check its cable and the hub")
    if serial_number is None and len(devices) > 1:
        raise RigError(
            f"{DEVICE}: there are {len(devices)} on USB; name one by its serial_number in config.yaml "
            "('mesotap devices' lists them)"
        )
    others: list[str] = []
    for candidate in devices:
        transport = UsbTransport(candidate, DEVICE)
        try:
            transport.open()
            device = Usb1608Protocol(transport)
            number = device.serial_number()
        except RigError as error:
            transport.close()
            if len(devices) == 1:
                raise
            others.append(str(error))
            continue
        if serial_number is None or number.lstrip("0").upper() == serial_number.lstrip("0").upper():
            return device, number
        transport.close()
        others.append(f"{number} on {transport.port}")
    raise RigError(f"{DEVICE}: none has serial number {serial_number}; found {'; '.join(others)}")
