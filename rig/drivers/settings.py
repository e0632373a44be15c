"""Settings of the drivers: what stands under ``rig.parts`` of config.yaml where a part is a real device."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rig.drivers.registers import PRESETS, RegisterMap
from rig.section import Finite, Positive, Section

Name = Annotated[str, Field(min_length=1)]
BAUD_RATES = {"conex-cc": 921600, "smc100": 57600}


class Amplifier(Section):
    """What every strain-gauge amplifier on Modbus needs to be told, whatever the wire."""

    preset: Literal["seneca-z-sg", "seneca-ze-sg3", "laumas-tlb"] | None = None
    registers: RegisterMap | None = None
    address: Annotated[int, Field(ge=1, le=247)] = 1
    mv_per_count: Positive = 2.0**-16
    excitation_v: Positive = 5.0
    readings_per_s: Annotated[float, Field(gt=0, le=1000)] = 100.0
    reply_timeout_s: Annotated[float, Field(gt=0, le=10)] | None = None  # None: from the replies' own time at connect
    tries: Annotated[int, Field(ge=1, le=10)] = 3
    expected_id: int | None = None

    @model_validator(mode="after")
    def _one_map(self) -> Amplifier:
        if (self.preset is None) == (self.registers is None):
            raise ValueError(f"give either preset ({', '.join(PRESETS)}) or registers, a map of your own")
        return self

    def map(self) -> RegisterMap:
        """Return the register map, the preset's or the one given."""
        return self.registers if self.registers is not None else PRESETS[self.preset or "seneca-z-sg"]


class AmplifierRtu(Amplifier):
    """Amplifier on a serial line, Modbus RTU."""

    driver: Literal["modbus-rtu"]
    port: Name
    baud_rate: Annotated[int, Field(ge=1200, le=1000000)] = 115200
    parity: Literal["none", "even", "odd"] = "none"
    stop_bits: Literal[1, 2] = 1


class AmplifierTcp(Amplifier):
    """Amplifier on Ethernet, Modbus TCP."""

    driver: Literal["modbus-tcp"]
    host: Name
    tcp_port: Annotated[int, Field(ge=1, le=65535)] = 502


class NewportStage(Section):
    """Newport CONEX-CC or SMC100 with its actuator; growing positions must go towards contact."""

    driver: Literal["conex-cc", "smc100"]
    port: Name
    baud_rate: Annotated[int, Field(ge=1200, le=1000000)] | None = None
    address: Annotated[int, Field(ge=1, le=31)] = 1
    zero_mm: Finite = 2.0
    lowest_mm: Finite = 0.0
    highest_mm: Finite = 12.0
    resolution_um: Positive = 0.02
    in_position_um: Positive = 0.1
    speed_um_per_s: Annotated[float, Field(gt=0, le=5000)] = 200.0  # apart; else as the wire allows
    poll_s: Annotated[float, Field(gt=0, le=0.1)] = 0.01
    home_at_connect: bool = False
    reply_timeout_s: Annotated[float, Field(gt=0, le=10)] | None = None  # None: from the replies' own time at connect
    tries: Annotated[int, Field(ge=1, le=10)] = 3
    expected_identity: str = ""

    @model_validator(mode="after")
    def _inside(self) -> NewportStage:
        if not self.lowest_mm < self.zero_mm < self.highest_mm:
            raise ValueError(
                f"zero_mm ({self.zero_mm:g}) must lie between lowest_mm ({self.lowest_mm:g}) and highest_mm "
                f"({self.highest_mm:g}), with room to take the surfaces apart below it"
            )
        return self

    def line_rate(self) -> int:
        """Return the baud rate: the one given, or the controller's own."""
        return BAUD_RATES[self.driver] if self.baud_rate is None else self.baud_rate
