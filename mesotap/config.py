"""config.yaml: read, validated, and refused in sentences that name the key, the value and what is allowed."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError, model_validator

from analysis.settings import AnalysisSettings
from calibration.settings import CalibrationSettings
from daq.errors import one_line
from daq.settings import DaqSettings
from mesotap.settings import SessionSettings
from rig.settings import RigSettings, Section
from sim_backend.settings import SimBackendSettings

DRIVERS = ("conex-cc", "smc100", "modbus-rtu", "modbus-tcp", "usb-1608fs-plus", "ni-9234", "solenoid")
TAGS = ("sphere", "flat", "literal", "name", *DRIVERS)
"""What validation adds to the path of a key to say which alternative of a choice was meant."""


class ConfigError(ValueError):
    """config.yaml cannot be used; one line a fault."""


_NOT_YAML = (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError)
"""What PyYAML raises on text that it cannot make anything of."""

LONGEST_SHOWN = 60
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxother = 3, LONGEST_SHOWN  # aliases in YAML can stand for more than memory holds


class Config(Section):
    """The whole of config.yaml, a section a package."""

    mesotap: SessionSettings = SessionSettings()
    rig: RigSettings = RigSettings()
    daq: DaqSettings = DaqSettings()
    calibration: CalibrationSettings = CalibrationSettings()
    analysis: AnalysisSettings = AnalysisSettings()
    sim_backend: SimBackendSettings = SimBackendSettings()

    @model_validator(mode="after")
    def _plan_within_limits(self) -> Config:
        highest = max(self.mesotap.load_plan_mn) + self.mesotap.load_tolerance_mn
        if highest > self.rig.limits.load_mn:
            raise ValueError(
                f"mesotap.load_plan_mn with its tolerance goes up to {highest:g} mN, past rig.limits.load_mn "
                f"({self.rig.limits.load_mn:g})"
            )
        record = self.daq.trigger
        if record.pretrigger_samples >= record.record_samples // 2:
            raise ValueError("daq.trigger.pretrigger_samples must be less than half of daq.trigger.record_samples")
        return self


def default_text() -> str:
    """Return the commented config.yaml that ships with the program."""
    return (Path(__file__).parent / "default_config.yaml").read_text(encoding="utf-8")


def load_config(path: Path | None, changes: Sequence[str] = ()) -> Config:
    """Read and validate a configuration.

    Parameters
    ----------
    path
        File to read; None takes ``config.yaml`` of the working folder, or the defaults where there is none.
    changes
        ``section.key=value`` settings that override the file, values in YAML.

    Raises
    ------
    ConfigError
        A line for each fault: file, line, key, value, what is allowed.
    """
    if path is None:
        here = Path("config.yaml")
        nothing = "--set" if changes else "the defaults"
        text, name = (here.read_text(encoding="utf-8"), "config.yaml") if here.is_file() else ("", nothing)
    else:
        try:
            text, name = path.read_text(encoding="utf-8"), str(path)
        except UnicodeDecodeError as error:
            raise ConfigError(f"{path}: is not a text file ({error.reason} at byte {error.start})") from error
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    return parse_config(text, name, changes)


def parse_config(text: str, name: str = "config.yaml", changes: Sequence[str] = ()) -> Config:
    """Validate the text of a configuration; see `load_config`."""
    try:
        node, content = _parsed(text)
    except _NOT_YAML as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or str(error) or type(error).__name__
        raise ConfigError(f"{name}{where}: is not YAML: {_shown(problem.splitlines()[0])}") from error
    if content is None:
        content = {}
    if not isinstance(content, dict):
        raise ConfigError(f"{name}: is no configuration: sections such as 'rig:' are expected at the top")
    for change in changes:
        _apply(content, change)
    try:
        return Config.model_validate(content)
    except ValidationError as error:
        lines = []
        for fault in error.errors():
            line = _line_of(node, fault["loc"])
            where = f"{name}, line {line}" if line else name
            lines.append(f"{where}: {_sentence(fault)}")
        raise ConfigError("\n".join(lines)) from error


def effective_text(config: Config) -> str:
    """Return the configuration in force, every key spelled out, as YAML."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True, default_flow_style=None)


def _apply(content: dict[str, Any], change: str) -> None:
    """Set ``section.key=value`` in the parsed file."""
    key, equals, value = change.partition("=")
    path = [part for part in key.strip().split(".") if part]
    if not equals or not path:
        raise ConfigError(f"--set {_shown(change)}: write section.key=value, such as mesotap.impacts_per_load=4")
    try:
        parsed = _parsed(value)[1]
    except _NOT_YAML as error:
        raise ConfigError(f"--set {_shown(change)}: the value is not YAML") from error
    place = content
    for part in path[:-1]:
        inner = place.get(part)
        if inner is None:
            inner = place[part] = {}
        if not isinstance(inner, dict):
            raise ConfigError(f"--set {_shown(change)}: {_shown(part)} holds no further keys")
        place = inner
    place[path[-1]] = parsed


def _parsed(text: str) -> tuple[Any, Any]:
    """Return YAML as nodes, which know their lines, and as values."""
    loader = yaml.SafeLoader(text)
    try:
        node = loader.get_single_node()
        return node, None if node is None else loader.construct_document(node)
    finally:
        loader.dispose()


def _shown(text: object) -> str:
    """Return what somebody wrote, fit for a sentence: on one line and not long."""
    line = one_line(str(text))
    return line if len(line) <= LONGEST_SHOWN else line[: LONGEST_SHOWN - 3] + "..."


def _sentence(fault: Any) -> str:
    key = ".".join(_shown(part) for part in fault["loc"] if part not in TAGS) or "configuration"
    message = one_line(str(fault["msg"]))
    if fault["type"] == "extra_forbidden":
        allowed = list(_allowed_keys(fault["loc"][:-1]))
        close = difflib.get_close_matches(str(fault["loc"][-1]), allowed, 1)
        meant = f"did you mean {close[0]}? " if close else ""
        return f"{key} is no known key; {meant}allowed here: {', '.join(sorted(allowed))}"
    if fault["type"] == "value_error":
        text = message.removeprefix("Value error, ")
        return f"{key}: {text}" if fault["loc"] else text
    return f"{key} is {_value(fault['input'])}: {message[0].lower()}{message[1:]}"


def _value(value: object) -> str:
    """Return a value of the file as it is shown; only the beginning of one that would fill pages, or memory."""
    try:
        return _shown(repr(value) if isinstance(value, str) else _SHORT.repr(value))
    except ValueError:
        return "a number of thousands of digits"


def _allowed_keys(path: tuple[Any, ...]) -> Iterator[str]:
    """Keys of the section at ``path``."""
    model: Any = Config
    for part in path:
        field = model.model_fields.get(part) if isinstance(model, type) and issubclass(model, BaseModel) else None
        if field is None:
            model = _variant(model, part)
            continue
        # an optional section is meant, where there is one, by a key inside of it
        inner = [a for a in getattr(field.annotation, "__args__", ()) if isinstance(a, type) and issubclass(a, Section)]
        model = inner[0] if len(inner) == 1 else field.annotation
    if isinstance(model, type) and issubclass(model, BaseModel):
        yield from model.model_fields


def _variant(model: Any, tag: Any) -> Any:
    """Return the alternative of a union that the tag, its ``geometry`` or its ``driver``, names."""
    pending = [model]
    while pending:
        candidate = pending.pop()
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            field = candidate.model_fields.get("geometry")
            if field is not None and field.default == tag:
                return candidate
            driver = candidate.model_fields.get("driver")
            if driver is not None and tag in getattr(driver.annotation, "__args__", ()):
                return candidate
        pending += list(getattr(candidate, "__args__", ()))
    return model


def _line_of(node: Any, path: tuple[Any, ...]) -> int | None:
    """Line of the file where the key at ``path`` stands, or the deepest part of it that is there."""
    line = None
    for part in path:
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if key.value == str(part):
                    line, node = key.start_mark.line + 1, value
                    break
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            node = node.value[part]
            line = node.start_mark.line + 1
    return line
