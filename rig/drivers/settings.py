"""Settings of the drivers: what stands under ``rig.parts`` of config.yaml where a part is a real device."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from rig.drivers.actuators import ACTUATORS, UNKNOWN_STEP_UM, ActuatorName
from rig.drivers.registers import LONGEST_SETTLING_S, PRESETS, RegisterMap
from rig.section import Finite, Positive, Section

Name = Annotated[str, Field(min_length=1)]
BAUD_RATES = {"conex-cc": 921600, "smc100": 57600}


class Amplifier(Section):
    """What every strain-gauge amplifier on Modbus needs to be told, whatever the wire."""

    preset: Literal["seneca-z-sg", "seneca-z-sg2", "seneca-ze-sg3", "laumas-tlb"] | None = None
    registers: RegisterMap | None = None
    address: Annotated[int, Field(ge=1, le=247)] = 1
    mv_per_count: Positive = 2.0**-16
    excitation_v: Positive = 5.0
    cell_ratio_mv_per_v: Positive | None = None
    cell_full_scale: Positive | None = None
    division: Positive = 1.0
    settling_s: Annotated[float, Field(ge=0, le=LONGEST_SETTLING_S)] | None = None  # None: as delivered
    readings_per_s: Annotated[float, Field(gt=0, le=1000)] = 100.0
    reply_timeout_s: Annotated[float, Field(gt=0, le=10)] | None = None  # None: from the replies' own time at connect
    tries: Annotated[int, Field(ge=1, le=10)] = 3
    expected_id: int | None = None

    @model_validator(mode="after")
    def _one_map(self) -> Amplifier:
        if (self.preset is None) == (self.registers is None):
            raise ValueError(f"give either preset ({', '.join(PRESETS)}) or registers, a map of your own")
        given = (self.cell_ratio_mv_per_v is not None) + (self.cell_full_scale is not None)
        if self.map().signal_is == "load" and self.map().ratio is None and given < 2:
            raise ValueError(
                "its signal is a weight, and where it keeps the load cell's ratio and full scale is not known: give "
                "cell_ratio_mv_per_v and cell_full_scale as they are set in the amplifier"
            )
        if given and (self.map().signal_is != "load" or self.map().ratio is not None):
            raise ValueError("cell_ratio_mv_per_v and cell_full_scale are of no use: its map does without them")
        return self

    def filter_settling_s(self) -> float:
        """Return in which time its filter follows the load: the one given, or as the preset is delivered."""
        return self.map().settling_s if self.settling_s is None else self.settling_s

    def map(self) -> RegisterMap:
        """Return the register map, the preset's or the one given."""
        return self.registers if self.registers is not None else PRESETS[self.preset or "seneca-ze-sg3"]


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
    """Newport CONEX-CC or SMC100 with its actuator; growing positions must go towards contact.

    ``actuator`` gives ``highest_mm`` and ``resolution_um`` where they are not given, and bounds them.
    """

    driver: Literal["conex-cc", "smc100"]
    port: Name
    baud_rate: Annotated[int, Field(ge=1200, le=1000000)] | None = None
    address: Annotated[int, Field(ge=1, le=31)] = 1
    actuator: ActuatorName | None = None
    zero_mm: Finite = 2.0
    lowest_mm: Finite = 0.0
    highest_mm: Finite = 12.0
    resolution_um: Positive = UNKNOWN_STEP_UM
    in_position_um: Positive = 0.1
    speed_um_per_s: Annotated[float, Field(gt=0, le=5000)] = 200.0  # apart; else as the wire allows
    poll_s: Annotated[float, Field(gt=0, le=0.1)] = 0.01
    home_at_connect: bool = False
    reply_timeout_s: Annotated[float, Field(gt=0, le=10)] | None = None  # None: from the replies' own time at connect
    tries: Annotated[int, Field(ge=1, le=10)] = 3
    expected_identity: str = ""

    @model_validator(mode="before")
    @classmethod
    def _by_the_actuator(cls, given: Any) -> Any:
        if not isinstance(given, dict) or given.get("actuator") not in ACTUATORS:
            return given
        model = ACTUATORS[given["actuator"]]
        speed = min(model.speed_um_per_s, cls.model_fields["speed_um_per_s"].default)
        return {"highest_mm": model.travel_mm, "resolution_um": model.step_um, "speed_um_per_s": speed, **given}

    @model_validator(mode="after")
    def _inside(self) -> NewportStage:
        if not self.lowest_mm < self.zero_mm < self.highest_mm:
            raise ValueError(
                f"zero_mm ({self.zero_mm:g}) must lie between lowest_mm ({self.lowest_mm:g}) and highest_mm "
                f"({self.highest_mm:g}), with room to take the surfaces apart below it"
            )
        if self.actuator is not None:
            model = ACTUATORS[self.actuator]
            if self.resolution_um < model.step_um:
                raise ValueError(
                    f"resolution_um ({self.resolution_um:g}) is finer than the smallest step of a {self.actuator}, "
                    f"{model.step_um:g} um; leave it out"
                )
            if self.lowest_mm < 0 or self.highest_mm > model.travel_mm:
                raise ValueError(
                    f"lowest_mm ({self.lowest_mm:g}) and highest_mm ({self.highest_mm:g}) must lie within the travel "
                    f"of a {self.actuator}, 0 to {model.travel_mm:g} mm"
                )
        return self

    def line_rate(self) -> int:
        """Return the baud rate: the one given, or the controller's own."""
        return BAUD_RATES[self.driver] if self.baud_rate is None else self.baud_rate
