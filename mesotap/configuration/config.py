"""config.yaml: read, validated, and refused in sentences that name the key, the value and what is allowed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError, model_validator

from analysis.settings import AnalysisSettings
from calibration.settings import CalibrationSettings
from daq.bounds import ACCELERATION, CORNER, MASS, STIFFNESS
from daq.errors import RecordingError, one_line
from daq.regular import read_regular
from daq.settings import DaqSettings
from mesotap.configuration.settings import CONFIG_VERSION, SessionSettings, Version
from mesotap.configuration.usual import unusual
from mesotap.configuration.yaml_text import (
    LARGEST_TEXT,
    NOT_YAML,
    NotTaken,
    line_of,
    not_yaml,
    parsed,
    sentence,
    shown,
    tags,
)
from rig.drivers.settings import NewportStage
from rig.errors import MesotapError
from rig.settable import too_fine, what_can_be_set
from rig.settings import RigSettings, Section
from sim_backend.settings import FOLDERS, SimBackendSettings

SLOWEST_HZ, FASTEST_HZ = 100.0, 1e8
"""Between what a recorder of a tester samples; see `rig.wiring.sample_rate_hz`."""


class ConfigError(MesotapError, ValueError):
    """config.yaml cannot be used; one line a fault."""


class Config(Section):
    """The whole of config.yaml, a section a package."""

    version: Version = CONFIG_VERSION
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
        self._rig_is_one()
        stage = self.rig.parts.stage
        if isinstance(stage, NewportStage):
            why = too_fine(self.mesotap.load_tolerance_mn, stage.resolution_um, self.rig.spring_stiffness())
            if why:
                raise ValueError(why)
        record = self.daq.trigger
        if record.pretrigger_samples >= record.record_samples // 2:
            raise ValueError("daq.trigger.pretrigger_samples must be less than half of daq.trigger.record_samples")
        return self

    def _rig_is_one(self) -> None:
        """Refuse a rig that the reader of its sessions would not believe."""
        rig = self.rig
        masses, corners, rate_hz = rig.masses, rig.filter, rig.wiring.sample_rate_hz
        if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
            raise ValueError(
                f"rig.wiring.sample_rate_hz is {rate_hz:g} Hz, expected {SLOWEST_HZ:g} to {FASTEST_HZ:g}: contact "
                "resonances lie between some hundred and ten thousand Hz"
            )
        k1, k2 = rig.spring_stiffness()
        described = {
            "rig.masses.m1_kg": (MASS, masses.m1_kg),
            "rig.masses.m2_kg": (MASS, masses.m2_kg),
            "rig.springs: k1": (STIFFNESS, k1),
            "rig.springs: k2": (STIFFNESS, k2),
            "rig.filter.highpass_hz": (CORNER, corners.highpass_hz),
            "rig.filter.lowpass_hz": (CORNER, corners.lowpass_hz),
            "rig.wiring: the full scale of the accelerometers": (ACCELERATION, rig.wiring.full_scale_m_s2()),
        }
        for key, (bound, value) in described.items():
            if fault := bound.fault(value):
                raise ValueError(f"{key} {fault}")
        inertia = rig.springs.inertia()
        if inertia is not None and inertia.added_kg >= min(masses.m1_kg, masses.m2_kg):
            raise ValueError(
                f"rig.springs: the tube springs add {inertia.added_kg:.3g} kg to each mass, as much as the masses "
                "themselves: correct tube, or give added_mass_kg"
            )
        if masses.uncertainty_kg >= min(masses.m1_kg, masses.m2_kg):
            raise ValueError(
                f"rig.masses.uncertainty_kg is {masses.uncertainty_kg:g} kg, as much as the masses themselves: a "
                "balance knows them to within less"
            )


def validated(content: dict[str, Any]) -> Config:
    """Validate the content of a configuration, a user's own mechanisms being known from it."""
    section = content.get("analysis")
    folders = section.get("mechanisms") if isinstance(section, dict) else None
    given = folders if isinstance(folders, list | tuple) else []
    known = [str(Path(folder).absolute()) for folder in given if isinstance(folder, str)]
    return Config.model_validate(content, context={FOLDERS: known})


def remarks(config: Config) -> list[str]:
    """Return in sentences what is unusual about a valid configuration, and to what its loads can be set."""
    return [*unusual(config.model_dump(mode="json")), *_aliased(config.rig), *_settable_loads(config)]


def _aliased(rig: RigSettings) -> list[str]:
    """Say where the recorder sees motions at wrong frequencies: its filter lets through more than it can tell."""
    highest_hz = rig.wiring.sample_rate_hz / 2
    if rig.filter.lowpass_hz <= highest_hz:
        return []
    return [
        f"rig.wiring.sample_rate_hz tells nothing above {highest_hz:g} Hz, and rig.filter.lowpass_hz "
        f"({rig.filter.lowpass_hz:g}) lets more through, which is then seen at other frequencies: "
        f"it needs at least {2 * rig.filter.lowpass_hz:g} Hz, unless the rate is in another unit than Hz"
    ]


def _settable_loads(config: Config) -> list[str]:
    """Return to what the loads of the plan can be set; nothing for a stage that is turned by hand."""
    part = config.rig.parts.stage
    if part == "hand":
        return []
    step_um = part.resolution_um if isinstance(part, NewportStage) else config.sim_backend.stage.resolution_um
    plan = config.mesotap
    return what_can_be_set(plan.load_plan_mn, plan.load_tolerance_mn, step_um, config.rig.spring_stiffness())


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
        path = Path("config.yaml")
        if not path.exists() and not path.is_symlink():
            return parse_config("", "--set" if changes else "the defaults", changes)
    return parse_config(text_of(path, "a configuration"), str(path), changes)


def text_of(path: Path, what: str) -> str:
    """Return the text of a file of settings; ``what`` it is goes into the sentence.

    Raises
    ------
    ConfigError
        It is not a file, no text, too large, or cannot be read.
    """
    try:
        return read_regular(path, LARGEST_TEXT, what).decode()
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not a text file ({error.reason} at byte {error.start})") from error
    except RecordingError as error:
        raise ConfigError(str(error)) from error


def parse_config(text: str, name: str = "config.yaml", changes: Sequence[str] = ()) -> Config:
    """Validate the text of a configuration; see `load_config`."""
    name = one_line(name)
    try:
        node, content = parsed(text)
    except NOT_YAML as error:
        raise ConfigError(not_yaml(name, error)) from error
    if content is None:
        content = {}
    if not isinstance(content, dict):
        raise ConfigError(f"{name}: is not a configuration: sections such as 'rig:' are expected at the top")
    changed = [_apply(content, change) for change in changes]
    try:
        return validated(content)
    except ValidationError as error:
        lines = [f"{name}: {remark}" for remark in unusual(content)]  # first: the faults may follow from them
        for fault in error.errors():
            line = line_of(node, fault["loc"])
            where = f"{name}, line {line}" if line else name
            keys = tuple(part for part in fault["loc"] if not tags(part))
            if any(keys[: len(path)] == path for path in changed):
                where = "--set"
            lines.append(f"{where}: {sentence(fault, Config)}")
        raise ConfigError("\n".join(lines)) from error


def effective_text(config: Config) -> str:
    """Return the configuration in force, every key spelled out, as YAML."""
    content = config.model_dump(mode="json")
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, default_flow_style=None)
    if all(line.isprintable() for line in text.split("\n")):
        return text
    # what a terminal would act on is written as escapes, which read back as the same
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=False, default_flow_style=None)


def _apply(content: dict[str, Any], change: str) -> tuple[str, ...]:
    """Set ``section.key=value`` in the parsed file; returns the path of the key."""
    key, equals, value = change.partition("=")
    path = [part for part in key.strip().split(".") if part]
    if not equals or not path:
        raise ConfigError(f"--set {shown(change)}: write section.key=value, such as mesotap.impacts_per_load=4")
    try:
        setting = parsed(value)[1]
    except NOT_YAML as error:
        what = f"the value: {error}" if isinstance(error, NotTaken) else "the value is not YAML"
        raise ConfigError(f"--set {shown(change)}: {what}") from error
    place = content
    for part in path[:-1]:
        inner = place.get(part)
        if inner is None:
            inner = place[part] = {}
        if not isinstance(inner, dict):
            raise ConfigError(f"--set {shown(change)}: {shown(part)} holds no further keys")
        place = inner
    place[path[-1]] = setting
    return tuple(path)
