"""Drivers of other packages: entry points of the group ``mesotap.drivers``, each a part of the rig with settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from rig.errors import RigError
from rig.interface import Accelerometers, Clock, Impactor, LoadCell, Operator, Stage
from rig.plugins import Offered, PluginError, offered, one_of, said_by
from rig.section import Section
from rig.written import EXPLAINED

if TYPE_CHECKING:
    from rig.drivers.transport import Transport
    from rig.settings import Wiring

GROUP = "mesotap.drivers"
"""Entry points of installed packages that hold a driver; the name is the one that config.yaml gives it."""

BUILT_IN = ("conex-cc", "smc100", "modbus-rtu", "modbus-tcp", "usb-1608fs-plus", "ni-9234", "solenoid")
"""Names of the program's own drivers, which no other may have."""

TAG = "plug-in"
"""Stands before a driver's name in the path of a setting that validation refuses."""

PartName = Literal["load_cell", "stage", "accelerometers", "impactor"]
Part = LoadCell | Stage | Accelerometers | Impactor
PARTS: Mapping[str, type[Part]] = {
    "load_cell": LoadCell,
    "stage": Stage,
    "accelerometers": Accelerometers,
    "impactor": Impactor,
}


def _as_it_is(wire: Transport) -> Transport:
    return wire


@dataclass(frozen=True, slots=True)
class Around:
    """What a driver finds around it.

    Attributes
    ----------
    clock
        Rig time; a driver sleeps and reads the time with nothing else.
    operator
        The person at the bench; None where a driver is made without one, as by the guardian.
    wiring
        Section ``rig.wiring``: which input is which sensor, ranges, sampling rate.
    largest_step_um
        The most that a stage may overshoot towards contact, um (``rig.limits.largest_approach_step_um``).
    recorded
        Passes a transport on, such that ``--record-wire`` records what goes over it.
    """

    clock: Clock
    operator: Operator | None
    wiring: Wiring
    largest_step_um: float
    recorded: Callable[[Transport], Transport] = _as_it_is


@dataclass(frozen=True, slots=True)
class DriverPlugin:
    """A driver that a package offers.

    Attributes
    ----------
    name
        As config.yaml names it, and as the entry point is named.
    part
        Which part of the rig it is: ``load_cell``, ``stage``, ``accelerometers`` or ``impactor``.
    settings
        A `rig.section.Section` with a field ``driver: Literal[name]``, and others as needed; units stand in the names.
    make
        Makes the part of its settings: an object of the abstract class of that part in `rig.interface`, and a
        `rig.drivers.driver.Driver` if it has to be connected. It talks to no device before ``connect``.
    example
        Settings as in config.yaml, without ``driver``; what can be left out may be.
    stand_in
        Opens something that behaves like the device, for `conformance`, and yields the settings, without ``driver``,
        that reach it. When it is closed the device is gone, and connections that are open are cut.
    summary
        What it drives, in a few words.
    """

    name: str
    part: PartName
    settings: type[Section]
    make: Callable[[Any, Around], Any]
    example: Mapping[str, Any] = field(default_factory=dict)
    stand_in: Callable[[Around], AbstractContextManager[Mapping[str, Any]]] | None = None
    summary: str = ""

    def made(self, settings: Section, around: Around) -> Any:
        """Return the part, not yet connected.

        Raises
        ------
        RigError
            It cannot be made, or is no such part.
        """
        try:
            part = self.make(settings, around)
        except RigError:
            raise
        except Exception as error:
            raise RigError(f"rig.parts.{self.part}: the driver {self.name} failed: {said_by(error)}") from error
        if not isinstance(part, PARTS[self.part]):
            raise RigError(
                f"rig.parts.{self.part}: the driver {self.name} makes a {type(part).__name__}, which is no "
                f"{PARTS[self.part].__name__} of rig.interface"
            )
        return part


def plugin_in(loaded: Any, where: str) -> DriverPlugin:
    """Return the driver that a module, or an entry point's value, holds.

    Raises
    ------
    PluginError
        It holds none, or one that lacks something.
    """
    held = loaded if isinstance(loaded, DriverPlugin) else getattr(loaded, "DRIVER", None)
    if not isinstance(held, DriverPlugin):
        raise PluginError(f"{where}: holds no DRIVER, a DriverPlugin of rig.drivers.plugins")
    if held.part not in PARTS:
        raise PluginError(f"{where}: its part {held.part!r} is none of {', '.join(PARTS)}")
    if not (isinstance(held.settings, type) and issubclass(held.settings, Section)):
        raise PluginError(f"{where}: its settings are no Section of rig.section")
    named = held.settings.model_fields.get("driver")
    if named is None or get_args(named.annotation) != (held.name,):
        raise PluginError(f'{where}: its settings need a field driver: Literal["{held.name}"]')
    return held


def offered_drivers() -> tuple[Offered, ...]:
    """Return the drivers that installed packages offer, none of them imported."""
    return offered(GROUP)


def load(entry: Offered) -> DriverPlugin:
    """Import a driver.

    Raises
    ------
    PluginError
        It cannot be used; or its name is another driver's.
    """
    if entry.name in BUILT_IN:
        raise PluginError(f"{entry.where()}: {entry.name} is a driver of mesotap's own; it needs another name")
    plugin = plugin_in(entry.loaded(), entry.where())
    if plugin.name != entry.name:
        raise PluginError(f"{entry.where()}: holds the driver {plugin.name}; both need the same name")
    return plugin


def installed(name: str) -> DriverPlugin | None:
    """Return the driver of that name of an installed package, None where no package offers one.

    Raises
    ------
    PluginError
        Several packages offer it, or it cannot be used.
    """
    found = one_of((o for o in offered_drivers() if o.name == name), f"the driver {name}")
    return None if found is None else load(found)


def settings_validator(part: PartName, known: str) -> Callable[[Any], Any]:
    """Return what makes settings of a driver that is none of the program's own.

    Parameters
    ----------
    part
        Which part of the rig it has to be.
    known
        The program's own choices for that part, for the sentence of one that is not known.
    """

    def validate(value: Any) -> Any:
        if isinstance(value, Section):
            return value
        name = str(value["driver"])
        try:
            plugin = installed(name)
        except PluginError as error:
            raise _fault("explained", str(error)) from error
        if plugin is None:
            raise _fault("part", f"is none of {known}, and no installed package offers a driver {name!r}")
        if plugin.part != part:
            raise _fault("part", f"is none of {known}: {name} is a driver of rig.parts.{plugin.part}")
        try:
            return plugin.settings.model_validate(value)
        except ValidationError as error:
            raise _within(name, error) from error

    return validate


def _fault(kind: Literal["part", "explained"], text: str) -> PydanticCustomError:
    return PydanticCustomError(EXPLAINED if kind == "explained" else "part", "{said}", {"said": text})


def _within(name: str, error: ValidationError) -> ValidationError:
    """Return the faults of a driver's settings, the driver's name before each path."""
    faults = []
    for fault in error.errors(include_url=False):
        kind = fault["type"]
        plain = kind in ("extra_forbidden", "missing")
        told: Any = kind if plain else PydanticCustomError(kind, "{said}", {"said": fault["msg"]})
        faults.append(InitErrorDetails(type=told, loc=(f"{TAG} {name}", *fault["loc"]), input=fault["input"]))
    return ValidationError.from_exception_data(name, faults)


def is_tag(part: object) -> bool:
    """Whether a part of the path to a setting only says which driver of another package was meant."""
    return isinstance(part, str) and (part == TAG or part.startswith(f"{TAG} "))


def settings_of_tag(part: str) -> type[BaseModel] | None:
    """Return the settings that such a part of a path belongs to."""
    plugin = installed(part.removeprefix(f"{TAG} "))
    return None if plugin is None else plugin.settings
