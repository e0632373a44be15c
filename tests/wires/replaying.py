"""A recorded dialogue played back to the drivers that its first line describes."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel

from rig.drivers.amplifier import DEVICE as AMPLIFIER
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.motor_stage import DEVICE as STAGE
from rig.drivers.motor_stage import MotorStage
from rig.drivers.settings import AmplifierRtu, NewportStage
from rig.drivers.wire_replay import ReplayClock, ReplayTransport, WireRecording, read_recording
from rig.errors import RigError
from rig.parts import Parts
from rig.settings import Limits
from sim_backend.emulators.rig import DEFAULT_AMPLIFIER, DEFAULT_STAGE


class Replayed:
    """Drivers at whose wires a recording answers.

    Attributes
    ----------
    load_cell, stage
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

    def connect(self) -> list[str]:
        """Connect each driver, in the order of the recording; what each said, or why it did not connect."""
        said = []
        drivers = {AMPLIFIER: self.load_cell, STAGE: self.stage}
        for device in self.wires:
            driver = drivers.get(device)
            if driver is None:
                continue
            try:
                said.append(driver.connect())
            except RigError as error:
                if type(error).__name__ == "WireMismatch":
                    raise
                said.append(str(error))
        return said
