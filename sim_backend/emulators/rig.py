"""The emulated rig: real drivers on emulated wires, with the simulated rig's physics at the other end.

A session here and one on the simulated rig with the same configuration and seed are equal to the last bit: the same
noise is drawn in the same order, and what goes over the wire (steps of the converters, positions in um with six
digits, virtual time) loses nothing.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from threading import RLock
from typing import Any

from rig import Accelerometers, Impactor, LoadCell, RigError, Stage
from rig.assembled import AssembledRig
from rig.drivers.amplifier import DEVICE as AMPLIFIER
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.motor_stage import DEVICE as STAGE
from rig.drivers.motor_stage import MotorStage
from rig.drivers.plugins import BUILT_IN
from rig.drivers.recorder_settings import Ni9234Settings, SolenoidSettings, Usb1608Settings
from rig.drivers.settings import AmplifierRtu, AmplifierTcp, NewportStage
from rig.drivers.solenoid import SolenoidImpactor
from rig.drivers.transport import SerialTransport, TcpTransport, Transport
from rig.drivers.usb1608 import Usb1608
from rig.drivers.wire_record import WireFile, recorded, recorded_usb
from rig.settings import Parts, RigSettings
from sim_backend.clock import VirtualClock
from sim_backend.emulators.amplifier import EmulatedAmplifier
from sim_backend.emulators.described import amplifier_of
from sim_backend.emulators.modbus import ModbusServer
from sim_backend.emulators.newport import EmulatedController
from sim_backend.emulators.newport_parameters import ControllerModel
from sim_backend.emulators.ports import PtyPort, TcpPort
from sim_backend.emulators.usb1608 import EmulatedUsb1608
from sim_backend.emulators.wire import Disturbance, InProcessTransport, VirtualTimeTransport
from sim_backend.recorder import calibration_table
from sim_backend.rig import SimulatedRig
from sim_backend.settings import SimBackendSettings

DEFAULT_AMPLIFIER = AmplifierRtu(driver="modbus-rtu", preset="seneca-ze-sg3", port="/dev/ttyUSB0")
DEFAULT_STAGE = NewportStage(driver="conex-cc", port="/dev/ttyUSB1", resolution_um=0.02)
PATIENCE_S = 2.0  # real time that an emulated device is given by a busy machine before it counts as silent


def emulated_of(parts: Parts) -> tuple[AmplifierRtu | AmplifierTcp, NewportStage]:
    """Return the settings of the amplifier and the stage that are emulated: those configured, else the usual ones.

    Raises
    ------
    RigError
        A part has a driver of another package, which nothing is emulated for.
    """
    for name in ("load_cell", "stage", "accelerometers", "impactor"):
        part = getattr(parts, name)
        if not isinstance(part, str) and part.driver not in BUILT_IN:
            raise RigError(
                f"rig.parts.{name}: nothing is emulated for {part.driver}, a driver of another package; take --simulate"
            )
    gauge, stage = parts.load_cell, parts.stage
    return (
        gauge if isinstance(gauge, AmplifierRtu | AmplifierTcp) else DEFAULT_AMPLIFIER,
        stage if isinstance(stage, NewportStage) else DEFAULT_STAGE,
    )


class EmulatedRig(AssembledRig):
    """Drivers as configured, defaults for parts that have none, and the emulated devices behind them.

    Parameters
    ----------
    rig_settings, settings, contact_stiffness, seed
        Of the simulated rig; see `SimulatedRig`.
    wires
        Over pseudo-terminals and TCP as a program outside would see them, or within the process, at the cost of a
        function call.
    amplifier_wire, stage_wire
        Faults on the wires; None for none.
    round_trip_s
        Of both wires, within the process.
    clock
        Of the physics; None for a virtual one.
    wire_file
        Where to record what goes over the wires; None for nowhere.
    actuator
        Name of the actuator, with its step, encoder and speed; empty for an ideal one.
    realistic
        Whether the amplifier converts, filters and rounds as one sold does.
    referenced
        Whether the stage's controller has found its home before; after power-on it has not.

    Attributes
    ----------
    physics
        The simulated rig behind the devices.
    amplifier, controller, recorder
        The emulated devices, to be made to fail.
    ports
        Pseudo-terminals and TCP servers, where ``wires`` asked for them.
    lock
        Held by a port while its device answers: one thing happens at a time.
    """

    def __init__(
        self,
        rig_settings: RigSettings,
        settings: SimBackendSettings,
        contact_stiffness: Callable[[float], float] | None = None,
        seed: int | None = None,
        wires: bool = False,
        amplifier_wire: Disturbance | None = None,
        stage_wire: Disturbance | None = None,
        round_trip_s: float = 0.0,
        clock: VirtualClock | None = None,
        wire_file: WireFile | None = None,
        actuator: str = "",
        realistic: bool = False,
        referenced: bool = True,
    ) -> None:
        self._wire_file = wire_file
        self.physics = physics = SimulatedRig(rig_settings, settings, contact_stiffness, False, seed, clock)
        if wire_file is not None:
            wire_file.set_clock(physics.clock)
        self.lock = RLock()
        parts = rig_settings.parts
        self._wires = wires
        self._round_trip_s = round_trip_s
        self.ports: list[PtyPort | TcpPort] = []
        gauge, motor = emulated_of(parts)
        load_cell = self._load_cell(gauge, amplifier_wire, realistic)
        self.controller = self._controller(motor, settings.stage.speed_um_per_s, actuator, referenced)
        stage: Stage = physics.stage
        if parts.stage != "hand":
            stage = self._motor_stage(motor, rig_settings.limits.largest_approach_step_um, stage_wire)
        accelerometers, impactor = self._recorder(rig_settings, settings)
        super().__init__("emulated rig", physics.clock, load_cell, stage, accelerometers, impactor, physics.weights)

    def open(self) -> list[str]:
        """Put the cables in, and connect every driver."""
        for port in self.ports:
            port.plug()
        return super().open()

    def close(self) -> None:
        """Let go of the devices, and take their ports away."""
        super().close()
        for port in self.ports:
            port.unplug()

    def tap_lower_mass(self, side: int = 0) -> None:
        """Have the person tap the lower mass by hand, whatever taps the upper one; see `SimulatedImpactor`."""
        self.physics.impactor.tap_lower_mass(side)

    def checkpoint(self) -> dict[str, Any]:
        """Return physics and devices as JSON types."""
        devices = {"amplifier": self.amplifier.checkpoint(), "controller": self.controller.checkpoint()}
        return {**self.physics.checkpoint(), "devices": devices}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        if "devices" not in state:
            raise RigError("The kept state is not of an emulated rig: resume this session as it was begun.")
        self.physics.restore(state)
        self.amplifier.restore(state["devices"]["amplifier"])
        self.controller.restore(state["devices"]["controller"])

    # --- the parts ------------------------------------------------------------------------------------------

    def _load_cell(
        self, settings: AmplifierRtu | AmplifierTcp, disturbance: Disturbance | None, realistic: bool
    ) -> LoadCell:
        framing = "rtu" if isinstance(settings, AmplifierRtu) else "tcp"
        self.amplifier = EmulatedAmplifier(
            self.physics.load_cell, amplifier_of(settings, realistic), self.physics.clock
        )
        self.physics.load_changed = self.amplifier.load_changed
        server = ModbusServer(self.amplifier, settings.address, framing)
        wire: Transport
        if not self._wires:
            port = settings.port if isinstance(settings, AmplifierRtu) else f"{settings.host}:{settings.tcp_port}"
            wire = InProcessTransport(AMPLIFIER, port, server, self.physics.clock, disturbance, self._round_trip_s)
        elif isinstance(settings, AmplifierRtu):
            pty = PtyPort(server, self._place("amplifier"), disturbance, self.lock)
            self.ports.append(pty)
            wire = self._in_virtual_time(SerialTransport(AMPLIFIER, str(pty.path), settings.baud_rate), pty)
        else:
            tcp = TcpPort(server, disturbance, self.lock)
            self.ports.append(tcp)
            wire = self._in_virtual_time(TcpTransport(AMPLIFIER, tcp.host, tcp.tcp_port), tcp)
        return ModbusLoadCell(recorded(wire, self._wire_file), framing, settings, self.physics.clock)

    def _controller(
        self, motor: NewportStage, speed_um_per_s: float, actuator: str, referenced: bool
    ) -> EmulatedController:
        model = ControllerModel(
            kind=motor.driver,
            address=motor.address,
            actuator=actuator,
            zero_mm=motor.zero_mm,
            lowest_mm=motor.lowest_mm,
            highest_mm=motor.highest_mm,
            referenced=referenced,
            seed=self.physics.seed,
        )
        return EmulatedController(self.physics.micrometer, model, speed_um_per_s, self.physics.clock)

    def _motor_stage(self, settings: NewportStage, step_um: float, disturbance: Disturbance | None) -> Stage:
        wire: Transport
        if self._wires:
            pty = PtyPort(self.controller, self._place("stage"), disturbance, self.lock)
            self.ports.append(pty)
            wire = self._in_virtual_time(SerialTransport(STAGE, str(pty.path), settings.line_rate()), pty)
        else:
            wire = InProcessTransport(
                STAGE, settings.port, self.controller, self.physics.clock, disturbance, self._round_trip_s
            )
        return MotorStage(recorded(wire, self._wire_file), settings, self.physics.clock, step_um)

    def _recorder(self, rig_settings: RigSettings, settings: SimBackendSettings) -> tuple[Accelerometers, Impactor]:
        parts, physics = rig_settings.parts, self.physics
        if isinstance(parts.accelerometers, Ni9234Settings):
            raise RigError(
                "rig.parts.accelerometers: the NI 9234 is not emulated, for its wire is NI's own; name a "
                "usb-1608fs-plus, or take --simulate"
            )
        recorder = parts.accelerometers if isinstance(parts.accelerometers, Usb1608Settings) else Usb1608Settings()
        solenoid = parts.impactor if isinstance(parts.impactor, SolenoidSettings) else None
        self.recorder = EmulatedUsb1608(
            physics.accelerometers.signal,
            physics.clock,
            calibration=calibration_table(settings.recorder, physics.seed),
            on_line=lambda line, high: self._switched(solenoid, line, high),
        )
        bus = recorded_usb(self.recorder.bus, self._wire_file)
        driver = Usb1608(rig_settings.wiring, recorder, physics.clock, bus)
        impactor: Impactor = physics.impactor
        if solenoid is not None:
            impactor = SolenoidImpactor(driver, solenoid, physics.clock)
        return driver, impactor

    def _switched(self, solenoid: SolenoidSettings | None, line: int, high: bool) -> None:
        """A solenoid on the recorder's line taps when it is switched on."""
        if solenoid is not None and line == solenoid.line and high:
            self.physics.impactor.tap(self.physics.true_load_mn())

    def _place(self, name: str) -> Path:
        return Path(tempfile.gettempdir()) / f"mesotap-emulated-{os.getpid()}-{id(self):x}" / name

    def _in_virtual_time(self, inner: Transport, port: PtyPort | TcpPort) -> Transport:
        return VirtualTimeTransport(inner, self.physics.clock, PATIENCE_S, lambda: port.taken)
