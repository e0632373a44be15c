"""Settings of the recorders and of the solenoid, as they stand in config.yaml under ``rig.parts``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rig.section import NonNegative, Positive, Section


class Usb1608Settings(Section):
    """MCC USB-1608FS-Plus.

    Attributes
    ----------
    serial_number
        Of the one to use, as on its label; any one if there is only one.
    reconnect_s
        How long a recorder that went off the bus is waited for within a recording. Short, for the surfaces are to be
        taken apart soon; a recorder that comes back later is found again by ``mesotap resume``.
    """

    driver: Literal["usb-1608fs-plus"] = "usb-1608fs-plus"
    serial_number: Annotated[str, Field(pattern=r"^[0-9A-Za-z]{1,8}$")] | None = None
    reconnect_s: NonNegative = 0.15


class Ni9234Settings(Section):
    """NI 9234 (four inputs, 24 bits, IEPE supply) through NI-DAQmx.

    Attributes
    ----------
    module
        Name of the module as NI-DAQmx shows it.
    iepe
        Whether the module feeds the accelerometers (2 mA); false behind a conditioner.
    settle_s
        Time that fed accelerometers are given to find their rest voltage after connecting.
    """

    driver: Literal["ni-9234"] = "ni-9234"
    module: Annotated[str, Field(pattern=r"^[0-9A-Za-z_-]{1,64}$")] = "cDAQ1Mod1"
    iepe: bool = True
    settle_s: NonNegative = 5.0


class SolenoidSettings(Section):
    """Solenoid impactor on a digital line of the recorder.

    Attributes
    ----------
    line
        Digital line that switches it, 0 to 7.
    pulse_ms, pulse_ms_per_n
        How long it is switched on: at no load, and more for each newton of preload.
    longest_pulse_ms
        Never longer than this, whatever the preload and the taps before.
    """

    driver: Literal["solenoid"] = "solenoid"
    line: Annotated[int, Field(ge=0, le=7)] = 0
    pulse_ms: Positive = 4.0
    pulse_ms_per_n: NonNegative = 2.0
    longest_pulse_ms: Annotated[float, Field(gt=0, le=100)] = 20.0
