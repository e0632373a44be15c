"""config.yaml as a form: its fields with what is written beside them, changes, their faults, and the difference."""

from __future__ import annotations

import difflib
import hashlib
import re
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import yaml
from pydantic import BaseModel

from daq.durable import write_whole
from mesotap.configuration.config import Config, ConfigError, default_text, parse_config, remarks, text_of
from mesotap.configuration.edited import as_written, edited, stands
from mesotap.configuration.yaml_text import parsed

KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*")
MOST_CHANGES = 200


class SettingsFile:
    """The console's configuration file.

    Parameters
    ----------
    path
        Where it is, or will be when it is saved first.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def text(self) -> str:
        """Return its text; that of the commented defaults where there is no file yet."""
        return text_of(self._path, "a configuration") if self._path.exists() else default_text()

    def form(self) -> dict[str, Any]:
        """What a page shows: fields in their order, and the state they are of."""
        text = self.text()
        config = parse_config(text, self._path.name)
        return {"name": self._path.name, "state": state_of(text), "fields": list(fields_of(config, text))}

    def changed(self, changes: dict[str, str], state: str) -> dict[str, Any]:
        """Return what these changes make of it: the faults that `config check` names, and the difference.

        Raises
        ------
        ConfigError
            The file was changed meanwhile, or a change is none.
        """
        before = self.text()
        if state_of(before) != state:
            raise ConfigError(f"{self._path.name} was changed by somebody else meanwhile; open the settings again")
        if len(changes) > MOST_CHANGES or not all(KEY.fullmatch(key) for key in changes):
            raise ConfigError("these are no changes of a configuration")
        texts = {path for path, _, annotation in _leaves(Config(), ()) if annotation is str}
        paths = {tuple(key.split(".")): str(value) for key, value in changes.items()}
        # whoever types a specimen's name knows nothing of YAML: '#7' and '12' are names too
        written = {path: as_written(value) if path in texts else value for path, value in paths.items()}
        after = edited(before, written, self._path.name)
        faults: list[str] = []
        said: list[str] = []
        try:
            said = remarks(parse_config(after, self._path.name))
        except ConfigError as error:
            faults = str(error).split("\n")
        lines = difflib.unified_diff(
            before.splitlines(), after.splitlines(), "as it is", "as it will be", lineterm="", n=1
        )
        return {"faults": faults, "said": said, "difference": list(lines), "text": after}

    def save(self, changes: dict[str, str], state: str) -> dict[str, Any]:
        """Save them, if there is no fault."""
        outcome = self.changed(changes, state)
        if not outcome["faults"]:
            write_whole(self._path, outcome["text"].encode())
        return {**outcome, "saved": not outcome["faults"]}


def state_of(text: str) -> str:
    """Return by what a text is known again."""
    return hashlib.sha256(text.encode()).hexdigest()


def fields_of(config: Config, text: str) -> Any:
    """Yield each value of a configuration that fits in a line: key, value as YAML, comment, and what it may be."""
    comments = comments_in(text)
    for path, value, annotation in _leaves(config, ()):
        if path == ("version",) or not stands(text, path):
            continue
        key = ".".join(path)
        shown = value if annotation is str else as_written(value)
        yield {
            "key": key,
            "value": shown,
            "comment": comments.get(key, ""),
            "choices": _choices(annotation),
        }


def _leaves(model: BaseModel, path: tuple[str, ...]) -> Any:
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            yield from _leaves(value, (*path, name))
        elif isinstance(value, str | int | float | bool) or value is None:
            yield (*path, name), value, field.annotation
        elif isinstance(value, list | tuple) and all(isinstance(v, str | int | float) for v in value):
            yield (*path, name), list(value), field.annotation


def _choices(annotation: Any) -> list[str]:
    """Values of a field that has only a few."""
    if annotation is bool:
        return ["true", "false"]
    return [str(value) for value in get_args(annotation)] if get_origin(annotation) is Literal else []


def comments_in(text: str) -> dict[str, str]:
    """Return the comment at the end of the line of each key, by its path."""
    found: dict[str, str] = {}
    lines = text.splitlines()

    def visit(node: Any, path: tuple[str, ...]) -> None:
        if not isinstance(node, yaml.MappingNode):
            return
        for key, value in node.value:
            line = lines[value.end_mark.line if isinstance(value, yaml.ScalarNode) else key.start_mark.line]
            comment = re.search(r"\s#\s?(.*)$", line)
            if comment and not isinstance(value, yaml.MappingNode):
                found[".".join((*path, key.value))] = comment[1].strip()
            visit(value, (*path, key.value))

    visit(parsed(text)[0], ())
    return found
