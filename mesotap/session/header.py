"""The header of a session folder: what was asked for, by which version, and whether this version can go on with it."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from daq.errors import RecordingError, one_line
from daq.impact_group import check_time
from daq.journal import HEADER, SessionFolder
from daq.journal_file import mend
from mesotap import __version__
from mesotap.configuration.config import Config, ConfigError, parse_config
from mesotap.configuration.versions import migrated
from mesotap.configuration.yaml_text import NOT_YAML, parsed
from mesotap.session.progress import VERSION

FOLDER_FORMAT = "mesotap-folder"
FOLDER_VERSION = 1
"""Of header, journal and impact files together; raised when an older program would misread them."""

SOFTWARE = f"mesotap {__version__}"
LONGEST_SHOWN = 60
LONGEST_SEED = 40  # digits; a generator takes in 128 bits
PHYSICAL = ("masses", "springs", "filter", "wiring")
MOST_ROUNDS = 20  # of taking out keys: a key within a key that is unknown too shows up only then


class Header(BaseModel):
    """``session.json``; a header without a format is of the first version."""

    model_config = ConfigDict(strict=True, extra="allow")

    format: Literal["mesotap-folder"] = "mesotap-folder"
    format_version: Annotated[int, Field(ge=1)] = 1
    created: str
    config: str
    simulated: bool = False
    emulated: bool = False
    seed: Annotated[int, Field(ge=0, lt=10**LONGEST_SEED)] = 0
    realtime: bool = False
    devices: str = ""
    software: str = ""

    @model_validator(mode="after")
    def _date(self) -> Header:
        check_time(self.created, "created")
        return self


@dataclass(frozen=True, slots=True)
class KeptConfig:
    """A configuration as a session keeps it, read by this version.

    Attributes
    ----------
    config
        What is in force.
    left_out
        Keys that this version does not know.
    defaults
        Keys that the text does not have, which now are at their defaults.
    """

    config: Config
    left_out: tuple[str, ...] = ()
    defaults: tuple[str, ...] = ()

    def differences(self) -> list[str]:
        """Return a sentence for each kind of difference."""
        said = []
        if self.left_out:
            said.append(
                f"its configuration is of another version; keys unknown here are left out: {', '.join(self.left_out)}"
            )
        if self.defaults:
            said.append(
                f"its configuration is of another version; keys it lacks take defaults: {', '.join(self.defaults)}"
            )
        return said


def read_header(folder: SessionFolder) -> Header:
    """Return the header of a session folder.

    Raises
    ------
    RecordingError
        An item is missing or of the wrong type (it is named), or a newer version wrote the folder.
    """
    fault = header_fault(folder.header)
    if fault:
        raise RecordingError(f"{folder.path / HEADER}: {fault}; {mend(folder.path)}")
    return Header.model_validate(folder.header)


def header_fault(header: dict[str, Any]) -> str:
    """Return what is wrong with a header; empty if nothing is."""
    version = header.get("format_version", 1)
    if isinstance(version, int) and version > FOLDER_VERSION:
        return (
            f"was written by a newer version ({_shown(header.get('software', 'unknown'))}, format {version}), which "
            f"alone goes on with it: this one, {SOFTWARE}, reads up to format {FOLDER_VERSION}"
        )
    try:
        Header.model_validate(header)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        field = ".".join(map(str, fault["loc"]))
        message = fault["msg"].removeprefix("Value error, ")
        what = f"{field} is missing" if fault["type"] == "missing" else f"{field}: {_shown(message)}".removeprefix(": ")
        return f"is damaged: {what}"
    return ""


def kept_config(text: str, name: str) -> KeptConfig:
    """Return the configuration in a session's header or file, as this version can understand it.

    Keys that it does not know are left out, keys that it has besides are at their defaults.

    Raises
    ------
    ConfigError
        A value that it does know is not allowed, or the text is not a configuration at all.
    """
    with contextlib.suppress(ConfigError):
        text = migrated(text, name)
    try:
        content = parsed(text)[1]
    except NOT_YAML:
        content = None
    left_out: list[str] = []
    if isinstance(content, dict):
        for _ in range(MOST_ROUNDS):
            unknown = _unknown(content)
            if not unknown:
                break
            for path in unknown:
                left_out.append(one_line(".".join(_take_out(content, path))))
        if left_out:
            text = yaml.safe_dump(content, sort_keys=False)
    config = parse_config(text, name)
    known = _keys(config.model_dump(mode="json"))
    given = _keys(content) if isinstance(content, dict) else set()
    missing = known - given
    # a text written by hand relies on defaults: nothing is missing there
    return KeptConfig(config, tuple(left_out), tuple(sorted(missing)) if 2 * len(missing) < len(known) else ())


def with_former_motor(header: Header, config: Config) -> Config:
    """Return a configuration whose simulated stage has the motor that it had in the first version.

    There, ``rig.parts.stage`` was of the real rig alone, and ``sim_backend.stage.hand_turned`` of the simulated one.
    """
    if not header.simulated or config.rig.parts.stage != "hand":
        return config
    try:
        motor = parsed(header.config)[1]["sim_backend"]["stage"]["hand_turned"] is False
    except (*NOT_YAML, LookupError, TypeError):
        return config
    if not motor:
        return config
    parts = config.rig.parts.model_copy(update={"stage": "simulated"})
    return config.model_copy(update={"rig": config.rig.model_copy(update={"parts": parts})})


def physical_part(text: str, name: str) -> Config | None:
    """Return a configuration of masses, springs, filter and wiring alone, from one that is refused for something else.

    None where masses or springs are not spelled out, or are what is refused: defaults are not taken for them.
    """
    try:
        content = parsed(text)[1]
        rig = {key: content["rig"][key] for key in PHYSICAL}
        return kept_config(yaml.safe_dump({"rig": rig}), name).config
    except (*NOT_YAML, ConfigError):
        return None


def note_version(folder: SessionFolder, header: Header, kept: KeptConfig, now: str) -> list[str]:
    """Note in the journal that another version goes on, once; returns what to tell about it.

    Parameters
    ----------
    now
        ISO 8601 UTC.
    """
    entry: dict[str, Any] = {"software": SOFTWARE, "left_out": list(kept.left_out), "defaults": list(kept.defaults)}
    noted: dict[str, Any] = {"software": header.software, "left_out": [], "defaults": []}
    for earlier in folder.events():
        if earlier["event"] == VERSION:
            noted = {key: earlier.get(key) for key in entry}
    if entry == noted:
        return []
    before = str(noted["software"] or "a version that did not say which")
    folder.append({"event": VERSION, "at": now, **entry, "before": before})
    begun = [] if before == SOFTWARE else [f"was run by {before}, {SOFTWARE} goes on"]
    return [f"{folder.path}: {one_line(said)}" for said in (*begun, *kept.differences())]


def _unknown(content: dict[str, Any]) -> list[tuple[Any, ...]]:
    try:
        Config.model_validate(content)
    except ValidationError as error:
        return [fault["loc"] for fault in error.errors(include_url=False) if fault["type"] == "extra_forbidden"]
    return []


def _take_out(content: dict[str, Any], path: tuple[Any, ...]) -> list[str]:
    """Delete a key by the path that validation gave it, in which the kind of an alternative may stand between keys.

    Returns the path as it stands in the text.
    """
    place: Any = content
    way = []
    for part in path[:-1]:
        in_list = isinstance(place, list) and isinstance(part, int) and part < len(place)
        if in_list or (isinstance(place, dict) and part in place):
            place = place[part]
            way.append(str(part))
    if isinstance(place, dict):
        place.pop(path[-1], None)
    return [*way, str(path[-1])]


def _keys(content: dict[str, Any], before: str = "") -> set[str]:
    found = set()
    for key, value in content.items():
        name = f"{before}.{key}" if before else str(key)
        found |= _keys(value, name) if isinstance(value, dict) and value else {name}
    return found


def _shown(value: object) -> str:
    text = one_line(str(value))
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."
