"""Section ``rig.parts`` of config.yaml: which implementation stands behind each part of the rig."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Tag

from rig.drivers.recorder_settings import Ni9234Settings, SolenoidSettings, Usb1608Settings
from rig.drivers.settings import AmplifierRtu, AmplifierTcp, NewportStage
from rig.section import Section

NAME = "name"  # tag of a part that is given by its name alone


def _tag(value: Any) -> str:
    """Return the driver that a part names, so that of a choice only the one meant is held against what is given."""
    if isinstance(value, dict):
        return str(value.get("driver", "no driver"))
    if isinstance(value, str):
        return NAME if value in ("simulated", "motor", "hand") else value
    return str(getattr(value, "driver", "no driver"))


StagePart = Annotated[
    Annotated[Literal["simulated", "motor", "hand"], Tag(NAME)]
    | Annotated[NewportStage, Tag("conex-cc")]
    | Annotated[NewportStage, Tag("smc100")],
    Discriminator(
        _tag,
        custom_error_type="part",
        custom_error_message="is none of simulated, hand, {driver: conex-cc, port: ...}, {driver: smc100, port: ...}",
    ),
]
LoadCellPart = Annotated[
    Annotated[Literal["simulated"], Tag(NAME)]
    | Annotated[AmplifierRtu, Tag("modbus-rtu")]
    | Annotated[AmplifierTcp, Tag("modbus-tcp")],
    Discriminator(
        _tag,
        custom_error_type="part",
        custom_error_message="is none of simulated, {driver: modbus-rtu, preset: ..., port: ...}, "
        "{driver: modbus-tcp, preset: ..., host: ...}",
    ),
]

AccelerometersPart = Annotated[
    Annotated[Literal["simulated"], Tag(NAME)]
    | Annotated[Usb1608Settings, Tag("usb-1608fs-plus")]
    | Annotated[Ni9234Settings, Tag("ni-9234")],
    Discriminator(
        _tag,
        custom_error_type="part",
        custom_error_message="is none of simulated, {driver: usb-1608fs-plus}, {driver: ni-9234, module: ...}",
    ),
]
ImpactorPart = Annotated[
    Annotated[Literal["hand"], Tag(NAME)] | Annotated[SolenoidSettings, Tag("solenoid")],
    Discriminator(
        _tag,
        custom_error_type="part",
        custom_error_message="is none of hand, {driver: solenoid, line: ...}",
    ),
]


class Parts(Section):
    """Which kind of implementation stands behind a part; ``motor`` is an older word for a simulated stage."""

    load_cell: LoadCellPart = "simulated"
    stage: StagePart = "motor"
    accelerometers: AccelerometersPart = "simulated"
    impactor: ImpactorPart = "hand"
    weights: Literal["hand"] = "hand"
