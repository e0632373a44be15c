"""From section ``rig`` of the configuration to a rig of drivers and hands."""

from __future__ import annotations

from functools import partial
from typing import Any

from usb.backend import libusb1

from rig.assembled import AssembledRig
from rig.drivers.amplifier import DEVICE as AMPLIFIER
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.motor_stage import DEVICE as STAGE
from rig.drivers.motor_stage import MotorStage
from rig.drivers.ni9234 import Ni9234
from rig.drivers.plugins import Around, installed
from rig.drivers.recorder_settings import Ni9234Settings, SolenoidSettings, Usb1608Settings
from rig.drivers.settings import AmplifierRtu, AmplifierTcp, NewportStage
from rig.drivers.solenoid import DigitalOutputs, SolenoidImpactor
from rig.drivers.transport import SerialTransport, TcpTransport, Transport
from rig.drivers.usb1608 import Usb1608
from rig.drivers.wire_record import WireFile, recorded, recorded_usb
from rig.errors import RigError
from rig.hand import HandImpactor, HandStage, HandWeights
from rig.interface import Accelerometers, Clock, Impactor, LoadCell, Operator, Stage
from rig.section import Section
from rig.settings import RigSettings
from rig.wall_clock import WallClock

NAME = "rig"


def assemble(
    settings: RigSettings, operator: Operator, clock: Clock | None = None, wire_file: WireFile | None = None
) -> AssembledRig:
    """Return the rig that ``rig.parts`` describes, not yet connected.

    Parameters
    ----------
    settings
        Section ``rig``.
    operator
        Who turns, taps and hangs weights where no motor does.
    clock
        Rig time; None for that of the machine.
    wire_file
        Where to record what goes over the wires; None for nowhere.

    Raises
    ------
    RigError
        A part is only simulated, or is asked for what it cannot do.
    """
    clock = WallClock() if clock is None else clock
    if wire_file is not None:
        wire_file.set_clock(clock)
    parts = settings.parts
    missing = [
        f"rig.parts.{name} (now {part})"
        for name, part in (
            ("load_cell", parts.load_cell),
            ("stage", parts.stage),
            ("accelerometers", parts.accelerometers),
        )
        if isinstance(part, str) and part != "hand"
    ]
    if missing:
        raise RigError(
            f"rig: no device is configured for {', '.join(missing)}; name its driver and port there, or add --simulate "
            "to work with the simulated rig"
        )
    gauge = load_cell(settings, operator, clock, wire_file)
    accelerometers = recorder(settings, operator, clock, wire_file)
    return AssembledRig(
        NAME,
        clock,
        gauge,
        stage(settings, operator, clock, gauge, wire_file),
        accelerometers,
        impactor(settings, operator, clock, accelerometers, wire_file),
        HandWeights(operator, clock),
    )


def load_cell(settings: RigSettings, operator: Operator, clock: Clock, wire_file: WireFile | None = None) -> LoadCell:
    """Return the driver of the strain-gauge amplifier, the program's own or another package's."""
    part = settings.parts.load_cell
    if isinstance(part, AmplifierRtu | AmplifierTcp):
        return amplifier(part, clock, wire_file)
    made: LoadCell = of_another(part, settings, operator, clock, wire_file)
    return made


def of_another(
    part: Section | str,
    settings: RigSettings,
    operator: Operator | None,
    clock: Clock,
    wire_file: WireFile | None = None,
) -> Any:
    """Return a part driven by another package's driver.

    Raises
    ------
    RigError
        It cannot be made.
    """
    name = str(getattr(part, "driver", part))
    plugin = installed(name)
    if plugin is None or not isinstance(part, Section):
        raise RigError(f"rig.parts: no installed package offers a driver {name!r} any more")
    around = Around(
        clock,
        operator,
        settings.wiring,
        settings.limits.largest_approach_step_um,
        partial(recorded, file=wire_file),
    )
    return plugin.made(part, around)


def amplifier(settings: AmplifierRtu | AmplifierTcp, clock: Clock, wire_file: WireFile | None = None) -> ModbusLoadCell:
    """Return the driver of the strain-gauge amplifier."""
    wire: Transport
    if isinstance(settings, AmplifierRtu):
        wire = SerialTransport(AMPLIFIER, settings.port, settings.baud_rate, settings.parity, settings.stop_bits)
        return ModbusLoadCell(recorded(wire, wire_file), "rtu", settings, clock)
    wire = TcpTransport(AMPLIFIER, settings.host, settings.tcp_port)
    return ModbusLoadCell(recorded(wire, wire_file), "tcp", settings, clock)


def motor_stage(
    part: NewportStage, largest_step_um: float, clock: Clock, wire_file: WireFile | None = None
) -> MotorStage:
    """Return the driver of the motor micrometer."""
    wire = SerialTransport(STAGE, part.port, part.line_rate())
    return MotorStage(recorded(wire, wire_file), part, clock, largest_step_um)


def stage(
    settings: RigSettings,
    operator: Operator,
    clock: Clock,
    load_cell: LoadCell,
    wire_file: WireFile | None = None,
) -> Stage:
    """Return the motor micrometer, or the one that is turned by hand."""
    part = settings.parts.stage
    if isinstance(part, NewportStage):
        return motor_stage(part, settings.limits.largest_approach_step_um, clock, wire_file)
    if isinstance(part, Section):
        made: Stage = of_another(part, settings, operator, clock, wire_file)
        return made
    return HandStage(operator, clock, lambda: f"gauge {load_cell.read().voltage_mv:.2f} mV")


def recorder(
    settings: RigSettings, operator: Operator, clock: Clock, wire_file: WireFile | None = None
) -> Accelerometers:
    """Return the driver of the recorder."""
    part = settings.parts.accelerometers
    if isinstance(part, Ni9234Settings):
        return Ni9234(settings.wiring, part, clock)
    if isinstance(part, Section) and not isinstance(part, Usb1608Settings):
        made: Accelerometers = of_another(part, settings, operator, clock, wire_file)
        return made
    chosen = part if isinstance(part, Usb1608Settings) else Usb1608Settings()
    bus = None if wire_file is None else libusb1.get_backend()
    return Usb1608(settings.wiring, chosen, clock, None if bus is None else recorded_usb(bus, wire_file))


def impactor(
    settings: RigSettings,
    operator: Operator,
    clock: Clock,
    accelerometers: Accelerometers,
    wire_file: WireFile | None = None,
) -> Impactor:
    """Return the solenoid, what another package taps with, or the person who taps."""
    part = settings.parts.impactor
    if isinstance(part, str):
        return HandImpactor(operator)
    if not isinstance(part, SolenoidSettings):
        made: Impactor = of_another(part, settings, operator, clock, wire_file)
        return made
    if not isinstance(accelerometers, DigitalOutputs):
        raise RigError(
            "rig.parts.impactor: a solenoid needs a digital line of a usb-1608fs-plus, which rig.parts.accelerometers "
            "does not name; tap by hand"
        )
    return SolenoidImpactor(accelerometers, part, clock)
