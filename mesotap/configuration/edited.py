"""A configuration's text with some values changed, and everything else of it, comments included, as it was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from mesotap.configuration.config import ConfigError
from mesotap.configuration.yaml_text import NOT_YAML, not_yaml, parsed, shown

Path = tuple[str, ...]


def edited(text: str, changes: Mapping[Path, str], name: str = "config.yaml") -> str:
    """Return a text with values set, as YAML, at paths of keys.

    A value that is there is exchanged where it stands; a key that is not there is put before the first one of its
    section. The outcome is YAML that has these values, and is not validated.

    Raises
    ------
    ConfigError
        The text or a value is no YAML, or at a key stands something that holds further keys.

    Examples
    --------
    >>> edited("rig: {a: 1}  # why\\n", {("rig", "a"): "2"})
    'rig: {a: 2}  # why\\n'
    """
    for path, value in changes.items():
        text = _with(text, path, _one_line(path, value), name)
    return text


def stands(text: str, path: Path) -> bool:
    """Whether a value can be set at a path: nothing but sections stands above it."""
    node = parsed(text)[0]
    for key in path:
        if not isinstance(node, yaml.MappingNode):
            return node is None or (isinstance(node, yaml.ScalarNode) and node.value in ("", "null", "~"))
        node = next((v for k, v in node.value if k.value == key), None)
    return not isinstance(node, yaml.MappingNode)


def _one_line(path: Path, value: str) -> str:
    """Return a value as it is written: what is no scalar and no list of them has no place in a line."""
    where = ".".join(path)
    try:
        node, content = parsed(value)
    except NOT_YAML as error:
        raise ConfigError(f"{where}: {shown(value)} is not YAML") from error
    if "\n" in value.strip() or isinstance(node, yaml.MappingNode) or not value.isprintable():
        raise ConfigError(f"{where}: {shown(value)} is not one value; change it in the file")
    if "#" in value or value.strip() == "" or isinstance(content, str):
        # as it is written within a list in one line, where more has to be quoted
        return as_written(content if value.strip() else "")
    return value.strip()


def as_written(value: object) -> str:
    """Return a value as YAML that stands within a line, letters of other alphabets as they are.

    Examples
    --------
    >>> as_written("plate #7: Müller")
    "'plate #7: Müller'"
    """
    return yaml.safe_dump([value], default_flow_style=True, width=10**6, allow_unicode=True).strip()[1:-1]


def _with(text: str, path: Path, value: str, name: str) -> str:
    try:
        node = parsed(text)[0]
    except NOT_YAML as error:
        raise ConfigError(not_yaml(name, error)) from error
    depth = 0
    while depth < len(path) and isinstance(node, yaml.MappingNode):
        inner = next((v for k, v in node.value if k.value == path[depth]), None)
        if inner is None:
            return _inserted(text, node, path[depth:], value)
        node, depth = inner, depth + 1
    if depth == len(path):
        if isinstance(node, yaml.MappingNode):
            raise ConfigError(f"{'.'.join(path)}: holds further keys; change it in the file")
        return _exchanged(text, node, value)
    if node is None:
        return text + ("" if text.endswith("\n") or not text else "\n") + _nested(path, value) + "\n"
    if isinstance(node, yaml.ScalarNode) and node.value in ("", "null", "~"):
        return _exchanged(text, node, "{" + _nested(path[depth:], value) + "}")
    raise ConfigError(f"{'.'.join(path[:depth])}: holds no further keys; change it in the file")


def _exchanged(text: str, node: Any, value: str) -> str:
    start, end = node.start_mark.index, node.end_mark.index
    if start == end:  # nothing stood there
        return f"{text[:start]} {value}{text[end:]}"
    tail = text[start:end][len(text[start:end].rstrip()) :]  # a list in lines ends with the line
    return f"{text[:start]}{value}{tail}{text[end:]}"


def _inserted(text: str, node: yaml.MappingNode, path: Sequence[str], value: str) -> str:
    entry = _nested(path, value)
    if not node.value:
        return _exchanged(text, node, "{" + entry + "}")
    at = node.value[0][0].start_mark
    if node.flow_style:
        return f"{text[: at.index]}{entry}, {text[at.index :]}"
    return f"{text[: at.index]}{entry}\n{' ' * at.column}{text[at.index :]}"


def _nested(path: Sequence[str], value: str) -> str:
    """Return ``a: {b: value}``."""
    opening = "".join(f"{key}: {{" for key in path[:-1])
    return f"{opening}{path[-1]}: {value}{'}' * (len(path) - 1)}"
