"""Section ``rig.parts`` of config.yaml: which implementation stands behind each part of the rig."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, PlainValidator, SerializeAsAny, Tag

from rig.drivers.plugins import BUILT_IN, TAG, PartName, settings_validator
from rig.drivers.recorder_settings import Ni9234Settings, SolenoidSettings, Usb1608Settings
from rig.drivers.settings import AmplifierRtu, AmplifierTcp, NewportStage
from rig.section import Section

NAME = "name"  # tag of a part that is given by its name alone


def _older_word(value: Any) -> Any:
    return "simulated" if value == "motor" else value


STAGES = "simulated, hand, {driver: conex-cc, port: ...}, {driver: smc100, port: ...}"
LOAD_CELLS = "simulated, {driver: modbus-rtu, preset: ..., port: ...}, {driver: modbus-tcp, preset: ..., host: ...}"
RECORDERS = "simulated, {driver: usb-1608fs-plus}, {driver: ni-9234, module: ...}"
IMPACTORS = "hand, {driver: solenoid, line: ...}"


def _tag(value: Any) -> str:
    """Return the driver that a part names, so that of a choice only the one meant is held against what is given."""
    if isinstance(value, str):
        return NAME if value in ("simulated", "hand") else value
    driver = value.get("driver") if isinstance(value, dict) else getattr(value, "driver", None)
    if driver is None:
        return "no driver"
    return str(driver) if driver in BUILT_IN or not isinstance(driver, str) else TAG


def _choice(known: str) -> Discriminator:
    return Discriminator(_tag, custom_error_type="part", custom_error_message=f"is none of {known}")


def _other(part: PartName, known: str) -> PlainValidator:
    """Return what takes the settings of a driver that another package brings."""
    return PlainValidator(settings_validator(part, known))


StagePart = Annotated[
    Annotated[Literal["simulated", "hand"], Tag(NAME)]
    | Annotated[NewportStage, Tag("conex-cc")]
    | Annotated[NewportStage, Tag("smc100")]
    | Annotated[SerializeAsAny[Section], _other("stage", STAGES), Tag(TAG)],
    _choice(STAGES),
    BeforeValidator(_older_word),
]
LoadCellPart = Annotated[
    Annotated[Literal["simulated"], Tag(NAME)]
    | Annotated[AmplifierRtu, Tag("modbus-rtu")]
    | Annotated[AmplifierTcp, Tag("modbus-tcp")]
    | Annotated[SerializeAsAny[Section], _other("load_cell", LOAD_CELLS), Tag(TAG)],
    _choice(LOAD_CELLS),
]
AccelerometersPart = Annotated[
    Annotated[Literal["simulated"], Tag(NAME)]
    | Annotated[Usb1608Settings, Tag("usb-1608fs-plus")]
    | Annotated[Ni9234Settings, Tag("ni-9234")]
    | Annotated[SerializeAsAny[Section], _other("accelerometers", RECORDERS), Tag(TAG)],
    _choice(RECORDERS),
]
ImpactorPart = Annotated[
    Annotated[Literal["hand"], Tag(NAME)]
    | Annotated[SolenoidSettings, Tag("solenoid")]
    | Annotated[SerializeAsAny[Section], _other("impactor", IMPACTORS), Tag(TAG)],
    _choice(IMPACTORS),
]


class Parts(Section):
    """Which kind of implementation stands behind a part; a simulated stage was once called ``motor``."""

    load_cell: LoadCellPart = "simulated"
    stage: StagePart = "simulated"
    accelerometers: AccelerometersPart = "simulated"
    impactor: ImpactorPart = "hand"
    weights: Literal["hand"] = "hand"
