"""The MCC USB-1608FS-Plus at its wire: requests, pacer, converters, FIFO, digital lines, and what can go wrong.

What the device is and understands is in `usb1608_manual`; nothing is taken from the driver of this project.

Time is the rig's. Samples are drawn from the source when they are fetched, block by block, so that a session over this
wire draws the same noise as one on the simulated recorder.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from usb.core import USBError

from rig import Clock
from sim_backend.emulators import usb1608_manual as manual
from sim_backend.emulators.usb_bus import UsbBus, gone, overflowed, stalled, timed_out
from sim_backend.recorder import Converter

BLOCK_SAMPLES = 256
"""Samples drawn from the source at a time; the simulated recorder's, so that both draw alike."""

OTHER_SERIAL_NUMBER = "01FFFFFF"
IDEAL: NDArray[np.float32] = np.tile(
    np.array([1.0, 0.0], dtype=np.float32), (manual.CALIBRATED_RANGES, manual.CHANNELS, 1)
)


class Fault(StrEnum):
    """What can be made to go wrong, each once, at the next transfer that it concerns."""

    OVERRUN = "overrun"  # the FIFO ran over: the scan stops, the endpoint stalls
    STALL = "stall"  # the endpoint stalls
    TIMEOUT = "timeout"  # one bulk transfer gets nothing
    HANG = "hang"  # nothing comes until the scan is started again
    SILENT = "silent"  # nothing answers at all, until it is plugged out and in
    SHORT = "short"  # a transfer ends early, after whole packets
    EMPTY = "empty"  # a zero-length packet
    TRUNCATED = "truncated"  # the last sample of a transfer is missing
    ODD = "odd"  # the last byte of a transfer is missing
    OVERFLOW = "overflow"  # more comes than there is room for
    FOREIGN = "foreign"  # the next answer to a request is somebody else's
    STOPPED = "stopped"  # the scan ends by itself
    UNPLUG = "unplug"  # the cable is pulled
    PLUG = "plug"  # it is plugged in again; seen by who looks at the bus
    REPLUG = "replug"  # both at once
    SWAPPED = "swapped"  # another device of the kind is plugged in in its place


class Source(Protocol):
    """What is wired to the inputs."""

    inputs: list[int]

    def begin(self, sample_rate_hz: float) -> None:
        """Be sampled from now on."""

    def take(self, samples: int) -> NDArray[np.float64]:
        """Return the next voltages, (inputs, samples), V, letting time pass until the last was taken."""

    def end(self) -> None:
        """Be sampled no longer."""


class EmulatedUsb1608:
    """The device.

    Parameters
    ----------
    source
        What is wired to the inputs; the others see 0 V.
    clock
        Rig time.
    serial_number
        Eight characters.
    calibration
        (8, 8, 2) slope and intercept of each range and input, as `calibration_table` draws them.
    on_line
        Called with line and level whenever an output changes.
    seed
        Of what foreign answers look like.
    pulled_up
        Whether the resistors pull lines that are inputs up, as they do on the USB-1608FS as sold (the maker's
        knowledge base, article 50352); a solenoid's driver then sees a high line until it is made an output.

    Attributes
    ----------
    bus
        A bus with nothing but this device, to be handed to pyusb.
    requests
        Numbers of the last thousand requests, in order.
    """

    vendor, product, endpoint, packet = 0x09DB, 0x00EA, 0x81, 64

    def __init__(
        self,
        source: Source,
        clock: Clock,
        serial_number: str = "01D2E3F4",
        calibration: NDArray[np.float32] = IDEAL,
        on_line: Callable[[int, bool], None] = lambda line, high: None,
        seed: int = 0,
        pulled_up: bool = False,
    ):
        self.serial_number = serial_number
        self.bus = UsbBus(self)
        self.requests: deque[int] = deque(maxlen=1000)
        self._source = source
        self._clock = clock
        self._calibration = calibration
        self._on_line = on_line
        self._rng = np.random.default_rng([seed, 7])
        self._faults: list[tuple[float, Fault]] = []
        self._pulled = 0xFF if pulled_up else 0
        self._inputs = self._latch = self._level = 0
        self.power_up()

    def inject(self, fault: Fault | str, at_s: float = 0.0) -> None:
        """Have something go wrong at the first transfer from ``at_s`` on, rig time."""
        self._faults.append((at_s, Fault(fault)))

    def look(self) -> None:
        """Somebody lists the bus: be on it again if it is time."""
        if self._happens(Fault.PLUG):
            self.bus.plug(self)

    def power_up(self) -> None:
        """Be as after plugging in."""
        self._source.end()
        self._scanning = self._overrun = self._halted = self._hung = self._silent = False
        self._fifo = bytearray()
        self._ranges = [0] * manual.CHANNELS
        self._channels: list[int] = []
        self._rate_hz = 1.0
        self._started_s = 0.0
        self._fetched = 0
        self._left: int | None = None  # scans to come; None for no end
        self._paced = self._stalls = True
        self._ends_empty = False
        self._set_outputs(manual.INPUTS, 0)  # the latch is 0 at power-on (J)

    # --- requests -------------------------------------------------------------------------------------------

    def control_out(self, request: int, value: int, data: bytes, timeout_s: float) -> None:
        """Take a vendor request; what the device does not know it stalls."""
        self._before_request(request, timeout_s)
        if request == manual.SCAN_START and len(data) == 10 and not self._scanning:
            self._start(*struct.unpack("<IIBB", data))
        elif request == manual.SCAN_STOP:
            self._stop()
        elif request == manual.CLEAR_FIFO:
            self._fifo.clear()
        elif request == manual.SCAN_RANGES and self._are_ranges(data):
            self._ranges = list(data)
        elif request == manual.STATUS:
            self._overrun = False  # writing clears the error indicators (J)
        elif request == manual.TRISTATE:
            self._set_outputs(value & 0xFF, self._latch)
        elif request in (manual.LATCH, manual.PORT):
            self._set_outputs(self._inputs, value & 0xFF)
        elif request == manual.RESET:
            self.power_up()
        elif request != manual.BLINK:
            raise stalled()

    def _are_ranges(self, data: bytes) -> bool:
        return len(data) == manual.CHANNELS and not self._scanning and manual.RANGES_V.keys() >= set(data)

    def control_in(self, request: int, value: int, length: int, timeout_s: float) -> bytes:
        """Answer a vendor request; what the device does not know it stalls."""
        self._before_request(request, timeout_s)
        answers = {
            manual.TRISTATE: lambda: bytes([self._inputs]),
            manual.PORT: lambda: bytes([self._level]),
            manual.LATCH: lambda: bytes([self._latch]),
            manual.SCAN_RANGES: lambda: bytes(self._ranges),
            manual.CALIBRATION: lambda: self._memory()[value : value + length],
            manual.STATUS: lambda: struct.pack("<H", manual.RUNNING * self._scanning | manual.OVERRUN * self._overrun),
            manual.SERIAL: lambda: self.serial_number.encode("ascii"),
        }
        if request not in answers or (request == manual.SCAN_RANGES and self._scanning):
            raise stalled()
        answer = answers[request]()
        if self._happens(Fault.FOREIGN):
            return self._rng.bytes(int(self._rng.integers(0, length + 1)))
        return answer[:length]

    def _before_request(self, request: int, timeout_s: float) -> None:
        self.requests.append(request)
        self._apply_wide_faults()
        if self._silent:
            raise self._wait_in_vain(timeout_s)

    def _memory(self) -> bytes:
        coefficients = self._calibration.astype("<f4").tobytes()
        return (coefficients + manual.CALIBRATION_DATE).ljust(manual.CALIBRATION_BYTES, b"\0")

    def _set_outputs(self, inputs: int, latch: int) -> None:
        before, after = self._level, latch & ~inputs | self._pulled & inputs
        self._inputs, self._latch, self._level = inputs, latch, after
        for line in range(8):
            if (before ^ after) >> line & 1:
                self._on_line(line, bool(after >> line & 1))

    def _start(self, count: int, pacer: int, mask: int, options: int) -> None:
        self._channels = [channel for channel in range(manual.CHANNELS) if mask >> channel & 1]
        # triggers, packets of single scans and the counter in place of samples are not emulated
        if not self._channels or options & (manual.TRIGGERS | manual.DEBUG | manual.IMMEDIATE):
            raise stalled()
        self._paced = pacer > 0  # else by a clock at SYNC, where nothing is connected
        self._rate_hz = min(manual.BASE_CLOCK_HZ / (pacer + 1), manual.LARGEST_RATE_HZ)
        self._left = count or None
        self._stalls = not options & manual.INHIBIT_STALL
        self._scanning, self._hung, self._ends_empty = True, False, False
        self._started_s = self._clock.now()
        self._fetched = 0
        self._converters = [
            Converter(manual.RANGES_V[self._ranges[i]], manual.BITS, *map(float, self._calibration[self._ranges[i], i]))
            for i in self._channels
        ]
        self._source.begin(self._rate_hz)

    def _stop(self) -> None:
        if self._scanning:
            # what was sampled since the last transfer stays in the FIFO; full scale, so that nobody takes it for data
            self._fifo += b"\xff" * self.packet
            self._end()

    def _end(self) -> None:
        self._scanning = False
        self._source.end()

    # --- the endpoint ---------------------------------------------------------------------------------------

    def bulk_in(self, length: int, timeout_s: float) -> bytes:
        """Send samples, whole packets until ``length`` is reached."""
        self._apply_wide_faults()
        if self._happens(Fault.STOPPED):
            self._stop()
            self._fifo.clear()
        if self._happens(Fault.HANG):
            self._hung = True
        if self._silent or self._hung or self._happens(Fault.TIMEOUT):
            raise self._wait_in_vain(timeout_s)
        if self._scanning and (self._backlog() > manual.FIFO_SAMPLES or self._happens(Fault.OVERRUN)):
            self._stop()
            self._overrun, self._halted = True, self._stalls
        if self._halted or self._happens(Fault.STALL):
            self._halted = True
            raise stalled()
        if self._happens(Fault.OVERFLOW):
            raise overflowed()
        if self._happens(Fault.EMPTY):
            return b""
        while len(self._fifo) < length and self._scanning:
            if not self._paced or self._due_s() > self._clock.now() + timeout_s:
                raise self._wait_in_vain(timeout_s)
            self._fifo += self._sample()
        if self._left == 0 and self._fifo:
            # a finite scan ends in a short packet, an empty one if its last packet was full (J, Q p. 30)
            self._ends_empty = len(self._fifo) <= length and len(self._fifo) % self.packet == 0
            return self._cut(length)
        if self._ends_empty:
            self._ends_empty = False
            return b""
        if len(self._fifo) < length:
            raise self._wait_in_vain(timeout_s)
        return self._cut(length)

    def clear_halt(self) -> None:
        """Take the endpoint back into use."""
        self._halted = False

    def _cut(self, length: int) -> bytes:
        content = bytes(self._fifo[:length])
        if self._happens(Fault.SHORT):
            content = content[: len(content) // 2 // self.packet * self.packet]
        del self._fifo[: len(content)]
        for fault, missing in ((Fault.TRUNCATED, 2), (Fault.ODD, 1)):
            if self._happens(fault):
                content = content[:-missing]
        return content

    def _backlog(self) -> float:
        """Samples that wait in the FIFO."""
        sampled = (self._clock.now() - self._started_s) * self._rate_hz
        return (sampled - self._fetched) * len(self._channels)

    def _due_s(self) -> float:
        """When the next block will have been sampled."""
        return self._started_s + (self._fetched + self._block()) / self._rate_hz

    def _block(self) -> int:
        """Scans drawn next."""
        return BLOCK_SAMPLES if self._left is None else min(BLOCK_SAMPLES, self._left)

    def _sample(self) -> bytes:
        samples = self._block()
        volts = self._source.take(samples)
        self._fetched += samples
        if self._left is not None:
            self._left -= samples
            if not self._left:
                self._end()
        codes = np.empty((samples, len(self._channels)), dtype="<u2")
        for column, (channel, convert) in enumerate(zip(self._channels, self._converters, strict=True)):
            wired = channel in self._source.inputs
            seen = volts[self._source.inputs.index(channel)] if wired else np.zeros(samples)
            codes[:, column] = convert.codes(seen)
        return codes.tobytes()

    def _wait_in_vain(self, timeout_s: float) -> USBError:
        self._clock.sleep(timeout_s)
        return timed_out()

    # --- faults ---------------------------------------------------------------------------------------------

    def _happens(self, fault: Fault) -> bool:
        """Whether this fault is due; it is then over."""
        now = self._clock.now()
        for item in self._faults:
            if item[1] is fault and item[0] <= now:
                self._faults.remove(item)
                return True
        return False

    def _apply_wide_faults(self) -> None:
        """Those that end a transfer of whichever kind."""
        if self._happens(Fault.SILENT):
            self._silent = True
        swapped = self._happens(Fault.SWAPPED)
        back = self._happens(Fault.REPLUG) or swapped
        if back or self._happens(Fault.UNPLUG):
            self.bus.unplug(self)
            if swapped:
                self.serial_number = OTHER_SERIAL_NUMBER
            if back:
                self.bus.plug(self)
            raise gone()


def bus_of(devices: Sequence[EmulatedUsb1608]) -> UsbBus:
    """Return one bus with several devices on it; faults that pull a cable act there."""
    bus = UsbBus(*devices)
    for device in devices:
        device.bus = bus
    return bus
