"""A recorded dialogue played back to the drivers that its first line describes."""

from __future__ import annotations

import errno
from collections import deque
from pathlib import Path

from pydantic import BaseModel
from usb.core import USBError, USBTimeoutError

from rig.drivers import usb1608_protocol as protocol
from rig.drivers.amplifier import DEVICE as AMPLIFIER
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.motor_stage import DEVICE as STAGE
from rig.drivers.motor_stage import MotorStage
from rig.drivers.recorder_settings import Usb1608Settings
from rig.drivers.settings import AmplifierRtu, NewportStage
from rig.drivers.usb1608 import Usb1608
from rig.drivers.wire_replay import Act, ReplayClock, ReplayTransport, WireMismatch, WireRecording, read_recording
from rig.errors import RigError
from rig.parts import Parts
from rig.settings import Limits, Wiring
from sim_backend.emulators.rig import DEFAULT_AMPLIFIER, DEFAULT_STAGE
from sim_backend.emulators.usb_bus import UsbBus

DEFAULT_RECORDER = Usb1608Settings()
LIBUSB_TIMED_OUT, LIBUSB_OTHER = -7, -99


class RecordedRecorder:
    """A recorder on an emulated bus that answers what a recording has, transfer by transfer."""

    vendor, product, endpoint, packet = protocol.VENDOR, protocol.PRODUCT, 0x81, 64

    def __init__(self, recording: WireRecording, clock: ReplayClock) -> None:
        self._path = recording.path
        self.left = deque(recording.transfers)
        self._clock = clock

    def control_out(self, request: int, value: int, data: bytes, timeout_s: float) -> None:
        """Take a request, which has to be the one of then."""
        self._next("control_out", (request, value), data)

    def control_in(self, request: int, value: int, length: int, timeout_s: float) -> bytes:
        """Answer as then."""
        return self._next("control_in", (request, value)).data

    def bulk_in(self, length: int, timeout_s: float) -> bytes:
        """Send what was sent then."""
        act = self._next("bulk_in", None)
        if act.length > len(act.data):
            raise WireMismatch(f"{self._path}, line {act.line}: its samples were not kept (--record-samples keeps all)")
        return act.data

    def clear_halt(self) -> None:
        """Be taken back into use."""
        self._next("clear_halt", None)

    def look(self) -> None:
        """Be listed."""

    def power_up(self) -> None:
        """Be plugged in."""

    def _next(self, act: str, asked: tuple[int, int] | None, data: bytes | None = None) -> Act:
        expected = self.left[0] if self.left else None
        if expected is None:
            raise WireMismatch(f"{self._path}: the recording is at its end, but the driver would {act} {asked or ''}")
        same = expected.act == act and (asked is None or expected.setup[1:3] == asked)
        if not same or (data is not None and data != expected.data):
            raise WireMismatch(
                f"{self._path}, line {expected.line}: the driver would {act} {asked or ''}, the recording has "
                f"{expected}"
            )
        self.left.popleft()
        self._clock.play(expected.time_s)
        if expected.errno == errno.ETIMEDOUT:
            raise USBTimeoutError(expected.error, LIBUSB_TIMED_OUT, errno.ETIMEDOUT)
        if expected.error:
            raise USBError(expected.error, LIBUSB_OTHER, expected.errno)
        return expected


class Replayed:
    """Drivers at whose wires a recording answers.

    Attributes
    ----------
    load_cell, stage, recorder
        The drivers; None for one that the recording does not speak to.
    """

    def __init__(self, recording: WireRecording | Path) -> None:
        if isinstance(recording, Path):
            recording = read_recording(recording)
        parts = Parts.model_validate(recording.header["parts"])
        self.clock = ReplayClock()
        self.wires = {device: ReplayTransport(recording, device, self.clock) for device in recording.devices()}
        self.load_cell: ModbusLoadCell | None = None
        self.stage: MotorStage | None = None
        if AMPLIFIER in self.wires:
            amplifier = parts.load_cell if isinstance(parts.load_cell, BaseModel) else DEFAULT_AMPLIFIER
            framing = "rtu" if isinstance(amplifier, AmplifierRtu) else "tcp"
            self.load_cell = ModbusLoadCell(self.wires[AMPLIFIER], framing, amplifier, self.clock)
        if STAGE in self.wires:
            motor = parts.stage if isinstance(parts.stage, NewportStage) else DEFAULT_STAGE
            step_um = recording.header.get("largest_approach_step_um", Limits().largest_approach_step_um)
            self.stage = MotorStage(self.wires[STAGE], motor, self.clock, step_um)

        self.recorder: Usb1608 | None = None
        self.usb = RecordedRecorder(recording, self.clock)
        if recording.transfers:
            kept = recording.header.get("wiring")
            wiring = Wiring() if kept is None else Wiring.model_validate(kept)
            chosen = parts.accelerometers if isinstance(parts.accelerometers, Usb1608Settings) else DEFAULT_RECORDER
            self.recorder = Usb1608(wiring, chosen, self.clock, UsbBus(self.usb))

    def connect(self) -> list[str]:
        """Connect each driver, in the order of the recording; what each said, or why it did not connect."""
        said = []
        drivers = {AMPLIFIER: self.load_cell, STAGE: self.stage}
        for driver in [*(drivers.get(device) for device in self.wires), self.recorder]:
            if driver is None:
                continue
            try:
                said.append(driver.connect())
            except RigError as error:
                if type(error).__name__ == "WireMismatch":
                    raise
                said.append(str(error))
        return said
