"""The MCC USB-1608FS-Plus as the recorder of a tester: a continuous stream in SI units that survives its faults.

A fault of the wire (overrun, stall, damaged or missing data, a device that went away and came back) costs the
samples of that moment, never the stream: the scan is started again and the next block's first sample says how many
are missing, by the clock.
"""

from __future__ import annotations

import array
import contextlib
import logging

import numpy as np
from usb.backend import IBackend

from rig.drivers import usb1608_protocol as protocol
from rig.drivers.driver import Driver
from rig.drivers.recorder_settings import Usb1608Settings
from rig.drivers.usb1608_protocol import DEVICE, NoRecorder, Status, Usb1608Protocol, find
from rig.drivers.usb1608_scale import Scale, check_wiring
from rig.drivers.usb_transport import UsbDead, UsbFault, UsbGone, UsbMute, UsbOverrun, UsbSilent
from rig.errors import RigError
from rig.hardware_log import repeated
from rig.interface import Accelerometers, Clock
from rig.readings import Block
from rig.settings import Wiring

LOG = logging.getLogger("mesotap.rig.recorder")

BLOCK_SAMPLES = 256
"""Samples of a block: with any number of inputs a whole number of packets."""

TRANSFER_MARGIN_S = 0.04
"""How much longer than a block lasts it is waited for. Like all patience here so short that the surfaces are apart
within half a second after the recorder has failed for good: while it is waited for, nobody watches the load."""

MOST_RESTARTS = 3
"""Times a scan is started again without one whole block before the recorder is given up."""

MOST_EMPTY_PACKETS = 8
"""Packets without a byte in a row that count as silence."""

LOOK_AGAIN_S = 0.05
"""Pause between looks for a recorder that went off the bus."""


class Usb1608(Accelerometers, Driver):
    """Recorder of accelerometers A and B, and of the strain gauge if that is wired to it.

    Parameters
    ----------
    wiring
        Section ``rig.wiring``.
    settings
        Which device, and how patient to be.
    clock
        Rig time; tells how many samples a gap has lost.
    backend
        Of pyusb; None for libusb.

    Attributes
    ----------
    sample_rate_hz
        What the pacer really gives, Hz.
    full_scale_m_s2
        Acceleration that both channels can hold, by their calibration once the device is open, m/s2.
    serial_number
        Of the device that was opened last; empty before.

    Raises
    ------
    RigError
        The wiring asks for something that this recorder does not have.
    """

    bits = protocol.BITS

    def __init__(
        self, wiring: Wiring, settings: Usb1608Settings, clock: Clock, backend: IBackend | None = None
    ) -> None:
        check_wiring(wiring)
        self.serial_number = ""
        self._settings = settings
        self._clock = clock
        self._backend = backend
        self._pacer = protocol.pacer_of(wiring.sample_rate_hz)
        self.sample_rate_hz = protocol.rate_of(self._pacer)
        self.full_scale_m_s2 = wiring.full_scale_m_s2()
        self._scale = Scale(wiring)
        self._wiring = wiring
        self._inputs, self._ranges_v = wiring.inputs(), wiring.ranges_v()
        self._column = [sorted(self._inputs).index(i) for i in self._inputs]  # samples come from low to high input
        self._buffer = array.array("B", bytes(BLOCK_SAMPLES * len(self._inputs) * 2))
        self._device: Usb1608Protocol | None = None
        self._outputs: set[int] = set()
        self._running = False
        self._started_s = 0.0
        self._next = 0

    # --- connection -----------------------------------------------------------------------------------------

    def connect(self) -> str:
        """Connect, read the calibration, and return a line that says what answered.

        Raises
        ------
        RigError
            No such recorder, another serial number, in use, or it does not answer as it should.
        """
        self._attach()
        wired = ", ".join(f"{i} (±{r:g} V)" for i, r in zip(self._inputs, self._ranges_v, strict=True))
        return (
            f"{DEVICE} {self.serial_number} on {self._opened().transport.port}: {self.sample_rate_hz:g} Hz, "
            f"inputs {wired}, full scale {self.full_scale_m_s2:.1f} m/s2"
        )

    def close(self) -> None:
        """Stop, and let go of the device; harmless when called twice."""
        self.stop()
        self._detach()

    def set_line(self, line: int, high: bool) -> None:
        """Set a digital line; the first use makes it an output.

        Raises
        ------
        RigError
            The device did not take it.
        """
        device = self._opened()
        if line not in self._outputs:
            device.make_output(line)
            self._outputs.add(line)
        device.set_line(line, high)

    def _opened(self) -> Usb1608Protocol:
        if self._device is None:
            raise RigError(f"{DEVICE}: it is not connected; check its cable")
        return self._device

    def _attach(self) -> None:
        self._detach()
        device, serial_number = find(self._settings.serial_number, self._backend)
        try:
            device.stop_scan()  # a program that was killed may have left one running
            wired = zip(self._inputs, self._ranges_v, strict=True)
            self._scale.calibrate([device.calibration(r, i) for i, r in wired])
        except RigError:
            device.transport.close()
            raise
        self._device, self.serial_number = device, serial_number
        self.full_scale_m_s2 = self._scale.full_scale_m_s2()

    def _detach(self) -> None:
        if self._device is not None:
            self._device.transport.close()
            self._device = None
            self._outputs.clear()

    # --- the stream -----------------------------------------------------------------------------------------

    def start(self) -> None:
        """Begin to stream; a recorder that was unplugged and came back is opened again.

        Raises
        ------
        RigError
            It does not start.
        """
        self.stop()
        self._next = 0
        if self._device is None:
            self._attach()
        fault: UsbFault | None = None
        for _ in range(MOST_RESTARTS + 1):
            try:
                if isinstance(fault, UsbGone):
                    self._come_back(fault)
                self._start_scan()
            except UsbFault as trouble:
                before, fault = fault, trouble
                repeated(LOG, DEVICE, "it did not start", fault.what)
                if _mute(before, fault):
                    break
            else:
                self._started_s = self._clock.now()
                self._running = True
                return
        raise self._given_up(fault)

    def read_block(self) -> Block:
        """Return the next 256 samples, waiting for them.

        After a fault that could be mended the block's ``first_sample`` leaves a gap for the samples lost.

        Raises
        ------
        RigError
            Not started, or the recorder could not be brought to stream again.
        """
        if not self._running:
            raise RigError(f"{DEVICE}: it does not stream; start it before blocks are read")
        fault: UsbFault | None = None
        for _ in range(MOST_RESTARTS + 1):
            try:
                if fault is not None:
                    self._restart(fault)
                return self._take(self._fill())
            except UsbFault as trouble:
                before, fault = fault, trouble
                if _mute(before, fault):
                    break
        self._running = False
        raise self._given_up(fault)

    def stop(self) -> None:
        """End the stream; harmless when it does not run, or when the recorder is gone."""
        if self._running and self._device is not None:
            # what ails it is told by whoever wants something of it next; start() begins from scratch
            with contextlib.suppress(RigError):
                self._device.stop_scan()
        self._running = False

    def _start_scan(self) -> None:
        device = self._opened()
        ranges = [0] * protocol.CHANNELS
        for channel, range_v in zip(self._inputs, self._ranges_v, strict=True):
            ranges[channel] = protocol.RANGE_CODES[range_v]
        device.stop_scan()
        device.clear_fifo()
        device.set_ranges(ranges)
        device.start_scan(self._pacer, sum(1 << channel for channel in self._inputs))

    def _restart(self, fault: UsbFault) -> None:
        """Bring the scan back to life, and leave a gap for what was lost meanwhile."""
        repeated(LOG, DEVICE, "the recording was started again", fault.what)
        if isinstance(fault, UsbGone):
            self._come_back(fault)
        else:
            device = self._opened()
            device.stop_scan()
            device.clear_fifo()
            if isinstance(fault, UsbOverrun):
                device.clear_errors()
            device.clear_halt()
        self._start_scan()
        since = self._clock.now() - self._started_s
        self._next = max(self._next + 1, round(since * self.sample_rate_hz))

    def _come_back(self, fault: UsbFault) -> None:
        """Wait for the recorder to be on the bus again, and connect to it."""
        self._detach()
        deadline = self._clock.now() + self._settings.reconnect_s
        while True:
            try:
                self._attach()
                repeated(LOG, DEVICE, "it went off the bus and came back")
                return
            except RigError as error:
                if self._clock.now() >= deadline:
                    self._running = False
                    said = fault if isinstance(error, NoRecorder) else error
                    raise RigError(str(said)) from error
            self._clock.sleep(LOOK_AGAIN_S)

    def _given_up(self, fault: UsbFault | None) -> RigError:
        return RigError(str(fault) if isinstance(fault, UsbDead) else f"{fault} (to start it again did not help)")

    def _fill(self) -> bytes | array.array[int]:
        """Return the bytes of one block, however the device cuts them into transfers."""
        device, wanted = self._opened(), len(self._buffer)
        timeout_s = BLOCK_SAMPLES / self.sample_rate_hz + TRANSFER_MARGIN_S
        try:
            count = device.read_into(self._buffer, timeout_s)
            if count == wanted:
                return self._buffer
            parts, empty = bytearray(self._buffer[:count]), 0
            while len(parts) < wanted:
                rest = array.array("B", bytes(wanted - len(parts)))
                count = device.read_into(rest, timeout_s)
                parts += rest[:count]
                empty = 0 if count else empty + 1
                if empty >= MOST_EMPTY_PACKETS:
                    raise device.transport.damaged("it sends packets without samples")
            return bytes(parts)
        except UsbFault as fault:
            if isinstance(fault, UsbGone):
                raise
            raise self._explained(device, fault) from fault

    def _explained(self, device: Usb1608Protocol, fault: UsbFault) -> UsbFault:
        """Return the fault in the words of the device's own status."""
        transport = device.transport
        try:
            status = device.status()
        except UsbMute as mute:
            if isinstance(fault, UsbSilent):
                raise UsbDead(mute.device, mute.port, mute.what, mute.check) from fault
            raise
        if Status.OVERRUN in status:
            return UsbOverrun(
                transport.name,
                transport.port,
                "its memory ran over, for this computer did not fetch the samples in time",
                "close other programs",
            )
        if isinstance(fault, UsbSilent):
            what = "it samples, but sends nothing" if Status.RUNNING in status else "it stopped by itself"
            return UsbSilent(transport.name, transport.port, what, "unplug it and plug it in again")
        return fault

    def _take(self, content: bytes | array.array[int]) -> Block:
        codes = np.frombuffer(content, "<u2").reshape(BLOCK_SAMPLES, -1).T[self._column]
        values = self._scale.units(codes.astype(np.float64))
        first = self._next
        self._next += BLOCK_SAMPLES
        return Block(first, values[:2], *self._wiring.sorted_out(list(values)))


def _mute(*faults: UsbFault | None) -> bool:
    """Whether two transfers in a row were not answered, so that asking again is a waste of time."""
    return isinstance(faults[-1], UsbDead) or all(isinstance(fault, UsbMute) for fault in faults)
