"""Configurations of older versions: rewritten as this one writes them, with everything else of their text as it was.

An older configuration is read as it is, since its former names are still understood; rewriting it says the same in the
present ones. What a version changed stands in `STEPS`, and nowhere else.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from mesotap.configuration.config import ConfigError, parse_config
from mesotap.configuration.edited import Path, edited
from mesotap.configuration.settings import CONFIG_VERSION
from mesotap.configuration.yaml_text import NOT_YAML, not_yaml, parsed

KEY = "version"
FIRST = 1
"""Of a configuration that has no version."""


@dataclass(frozen=True, slots=True)
class Renamed:
    """A key that has another name now."""

    path: Path
    name: str


@dataclass(frozen=True, slots=True)
class Reworded:
    """A value that is written otherwise now."""

    path: Path
    old: str
    new: str


STEPS: dict[int, tuple[Renamed | Reworded, ...]] = {
    2: (
        Renamed(("sim_backend", "contact", "contact_stiffness_mn_per_m"), "contact_stiffness_n_per_um"),
        Renamed(("daq", "quality", "second_blow_ratio"), "second_impact_ratio"),
        Reworded(("rig", "parts", "stage"), "motor", "simulated"),
    ),
}
"""What changed with a version, by the version it changed in."""


def version_of(text: str) -> int:
    """Return the version of a configuration, `FIRST` where it does not say; one that is none counts as this one."""
    with contextlib.suppress(*NOT_YAML):
        content = parsed(text)[1]
        said = content.get(KEY, FIRST) if isinstance(content, dict) else FIRST
        return said if type(said) is int else CONFIG_VERSION
    return CONFIG_VERSION


def remark_on(text: str, name: str) -> str:
    """Return in a sentence what to do about a configuration of an older version; empty for one of this version."""
    version = version_of(text)
    if version >= CONFIG_VERSION:
        return ""
    return (
        f"{name}: is of version {version}, and read as that; 'mesotap config migrate {name}' writes it as version "
        f"{CONFIG_VERSION}, with its comments"
    )


def migrated(text: str, name: str = "config.yaml") -> str:
    """Return a configuration's text as this version writes it: former names and words exchanged where they stand.

    Parameters
    ----------
    text
        Of any version up to this one.
    name
        Of the file, for sentences.

    Raises
    ------
    ConfigError
        The text is no YAML.
    """
    version = version_of(text)
    if version >= CONFIG_VERSION:
        return text
    for step in range(version + 1, CONFIG_VERSION + 1):
        for change in STEPS[step]:
            text = _changed(text, change, name)
    return _with_version(text, name)


def migrated_soundly(text: str, name: str) -> str:
    """Return `migrated` text that has been validated, and means what it meant before.

    Raises
    ------
    ConfigError
        The configuration is not valid, or would mean something else.
    """
    after = migrated(text, name)
    if parse_config(after, name) != parse_config(text, name):
        raise ConfigError(f"{name}: would not mean the same as version {CONFIG_VERSION}; it is left as it is")
    return after


def _changed(text: str, change: Renamed | Reworded, name: str) -> str:
    found = _found(_node(text, name), change.path)
    if found is None:
        return text
    key, value = found
    if isinstance(change, Renamed):
        return _exchanged(text, key, change.name)
    if isinstance(value, yaml.ScalarNode) and value.value == change.old:
        return _exchanged(text, value, change.new)
    return text


def _node(text: str, name: str) -> Any:
    try:
        return parsed(text)[0]
    except NOT_YAML as error:
        raise ConfigError(not_yaml(name, error)) from error


def _found(node: Any, path: Path) -> tuple[yaml.Node, yaml.Node] | None:
    """Return the nodes of a key and its value."""
    found = None
    for part in path:
        pairs: Iterator[tuple[yaml.Node, yaml.Node]] = iter(node.value if isinstance(node, yaml.MappingNode) else ())
        found = next(((key, value) for key, value in pairs if key.value == part), None)
        if found is None:
            return None
        node = found[1]
    return found


def _exchanged(text: str, node: yaml.Node, new: str) -> str:
    return text[: node.start_mark.index] + new + text[node.end_mark.index :]


def _with_version(text: str, name: str) -> str:
    """Return the text with the version in it: in its place, or above the first section and what is said of it."""
    node = _node(text, name)
    wanted = str(CONFIG_VERSION)
    if _found(node, (KEY,)) is not None or not isinstance(node, yaml.MappingNode) or not node.value or node.flow_style:
        return edited(text, {(KEY,): wanted}, name)
    lines = text.splitlines(keepends=True)
    place = node.value[0][0].start_mark.line
    while place > 0 and lines[place - 1].lstrip().startswith("#"):
        place -= 1
    if place == 0 and lines[0].lstrip().startswith("#"):
        place = node.value[0][0].start_mark.line  # what is said above all is said of the file
    return "".join([*lines[:place], f"{KEY}: {wanted}\n", *lines[place:]])
