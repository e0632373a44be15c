"""Who is behind a serial port: the drivers' own questions, asked at the usual speeds; none changes anything."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from rig.drivers.modbus import ModbusDevice
from rig.drivers.newport import NewportAxis
from rig.drivers.registers import ONE_MAKER, PRESETS, fits
from rig.drivers.settings import BAUD_RATES
from rig.drivers.transport import SerialTransport, Transport
from rig.errors import DeviceError, NoAnswer
from rig.interface import Clock

ADDRESS = 1
"""Where makers set their devices; others are asked once they are configured."""

MODBUS_BAUD_RATES = (115200, 38400, 19200, 9600)
REPLY_S = 0.15
NOBODY = "nothing that mesotap drives answers"

Wire = Callable[[int], Transport]


def who_answers(port: str, clock: Clock, wire: Wire | None = None) -> str:
    """Return in words what answers on a serial port, and how it is to be configured.

    The stage's question goes first: it is a line of text, which an amplifier on Modbus passes over.

    Parameters
    ----------
    port
        Such as ``/dev/ttyUSB0``.
    clock
        Rig time.
    wire
        Makes the transport for a baud rate; None for that of the port.

    Raises
    ------
    DeviceError
        The port cannot be opened: forbidden, gone, or used by another program.
    """
    wire = wire or (lambda rate: SerialTransport("serial port", port, rate))
    for driver, rate in BAUD_RATES.items():
        said = _asked(wire(rate), lambda transport: _stage(transport, clock))
        if said:
            return f"{said}; rig.parts.stage: {{driver: {driver}, port: {port}}}"
    for rate in MODBUS_BAUD_RATES:
        said = _asked(wire(rate), lambda transport: _amplifier(transport, clock))
        if said:
            return f"{said}; rig.parts.load_cell: {{driver: modbus-rtu, port: {port}, baud_rate: {rate}, preset: ...}}"
    return NOBODY


def _asked(transport: Transport, question: Callable[[Transport], str]) -> str:
    transport.open()
    try:
        return question(transport)
    except NoAnswer:
        return ""
    finally:
        transport.close()


def _stage(transport: Transport, clock: Clock) -> str:
    version = NewportAxis(transport, ADDRESS, clock, REPLY_S, tries=1).version()
    return f"a stage controller, '{version}'"


def _amplifier(transport: Transport, clock: Clock) -> str:
    device = ModbusDevice(transport, "rtu", ADDRESS, clock, REPLY_S, tries=1)
    try:
        first = f"its first register reads {device.read('holding', 0, 1)[0]}"
    except NoAnswer:
        raise
    except DeviceError as error:  # an exception code is an answer too
        first = f"asked for its first register {error.what}"
    return f"a device on Modbus at address {ADDRESS}, {first}{_like(device)}"


def _like(device: ModbusDevice) -> str:
    """Say which of the presets that can be told apart it reads like."""
    with suppress(NoAnswer):
        for preset in ONE_MAKER:
            if fits(PRESETS[preset], lambda offset: device.read("holding", offset, 1)[0]):
                return f", and it reads like a {preset}"
    return ""
