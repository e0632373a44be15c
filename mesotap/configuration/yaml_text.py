"""YAML that people write: read with the lines of its keys, and its faults told in sentences."""

from __future__ import annotations

import copy
import difflib
import re
import reprlib
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import yaml
from pydantic import BaseModel

from daq.errors import one_line
from rig.drivers.plugins import BUILT_IN, is_tag, settings_of_tag
from rig.settings import Section
from rig.written import EXPLAINED, NUMBER, how_to_write

KEY = "[key]"  # what validation adds to the path of a key that is no good itself
TAGS = ("sphere", "flat", "literal", "name", *BUILT_IN)
"""What validation adds to the path of a key to say which alternative of a choice was meant."""

NOT_YAML = (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError)
"""What PyYAML raises on text that it cannot make anything of."""

LONGEST_SHOWN = 60
LARGEST_TEXT = 100_000
"""Bytes; the configuration with all its comments has ten thousand."""

MOST_ENTRIES = 20_000
"""Keys and values of a text with its aliases written out."""

TEXTS_KEPT = 16
"""Whose values are kept: one command reads the same configuration several times, and each time takes 0.1 s."""

HIDDEN_LINE_END = re.compile("[\x85\u2028\u2029]")
SHOWN_LINE_END = re.compile("\r\n?|\n")
PLAIN_FLOAT = r"(?:[-+]?(?:0|[1-9][0-9]*)\.[0-9]*|\.[0-9]+)(?:[eE][-+][0-9]+)?"
NO_NUMBER = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxother = 3, LONGEST_SHOWN  # aliases in YAML can stand for more than memory holds


def not_yaml(name: str, error: Exception) -> str:
    """Return the sentence for one of `NOT_YAML`."""
    name = one_line(name)
    if isinstance(error, NotTaken):
        return f"{name}: {error}"
    mark = getattr(error, "problem_mark", None)
    where = f", line {mark.line + 1}" if mark is not None else ""
    problem = getattr(error, "problem", None) or str(error) or type(error).__name__
    return f"{name}{where}: is not YAML: {shown(problem.splitlines()[0])}"


class NotTaken(ValueError):
    """YAML that is sound, and not taken: its text is the reason."""


def parsed(text: str) -> tuple[Any, Any]:
    """Return YAML as nodes, which know their lines and are not to be altered, and as values of the caller's own.

    Raises
    ------
    Exception
        One of `NOT_YAML`.
    """
    if len(text) > LARGEST_TEXT:
        raise NotTaken(f"it is longer than {LARGEST_TEXT // 1000} kB")
    _refuse_hidden_line_ends(text)
    node, values = _read(text)
    return node, copy.deepcopy(values)


@lru_cache(TEXTS_KEPT)
def _read(text: str) -> tuple[Any, Any]:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None, None
        _written_out(node, {}, set())
        return node, loader.construct_document(node)
    finally:
        loader.dispose()


def _refuse_hidden_line_ends(text: str) -> None:
    """Refuse line ends that editors do not show: what follows one in a comment would be a setting."""
    found = HIDDEN_LINE_END.search(text)
    if found is not None:
        line = len(SHOWN_LINE_END.findall(text, 0, found.start())) + 1
        raise NotTaken(
            f"line {line}: holds the character U+{ord(found[0]):04X}, which ends a line in YAML and not on the screen; "
            "take it out, or write it as an escape within double quotes"
        )


class _Loader(yaml.SafeLoader):
    """YAML 1.1 without what turns into another value than people mean: octal, binary, hexadecimal and sexagesimal
    numbers, digits with underscores, dates, and yes, no, on, off. All of these are text here."""

    def _number(self, node: yaml.ScalarNode) -> int | float:
        text = self.construct_scalar(node)
        if not (NUMBER.fullmatch(text) or NO_NUMBER.fullmatch(text)):
            raise NotTaken(f"line {node.start_mark.line + 1}: {how_to_write(shown(text))}")
        if node.tag.endswith(":int"):
            return int(text)
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))

    def _boolean(self, node: yaml.ScalarNode) -> bool:
        text = self.construct_scalar(node).lower()
        if text not in ("true", "false"):
            raise NotTaken(f"line {node.start_mark.line + 1}: {shown(text)} is neither true nor false")
        return text == "true"


_Loader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?(?:0|[1-9][0-9]*)", "-+0123456789"),
    # what it leaves out, such as 1.5e5, is a number where one belongs, and otherwise text: as PyYAML writes it
    ("float", rf"{PLAIN_FLOAT}|{NO_NUMBER.pattern}", "-+0123456789."),
    ("merge", r"<<", "<"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"^(?:{_pattern})$"), list(_first))
for _tag in ("int", "float"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_tag}", _Loader._number)
_Loader.add_constructor("tag:yaml.org,2002:bool", _Loader._boolean)


def _written_out(node: yaml.Node, counted: dict[int, int], above: set[int]) -> int:
    """Return how many entries a node has with its aliases written out: each may stand for many that stand for many.

    Raises
    ------
    NotTaken
        They are more than anybody means, one stands inside of itself, or a key is there twice.
    """
    if id(node) in counted:
        return counted[id(node)]
    if id(node) in above:
        raise NotTaken(f"line {node.start_mark.line + 1}: an alias stands inside of what it stands for")
    inner: list[yaml.Node] = []
    if isinstance(node, yaml.MappingNode):
        _refuse_twice(node)
        inner = [part for entry in node.value for part in entry]
    elif isinstance(node, yaml.SequenceNode):
        inner = node.value
    above.add(id(node))
    count = 1
    for part in inner:
        count += _written_out(part, counted, above)
        if count > MOST_ENTRIES:
            raise NotTaken(f"line {part.start_mark.line + 1}: its aliases stand for more than {MOST_ENTRIES} entries")
    above.remove(id(node))
    counted[id(node)] = count
    return count


def _refuse_twice(node: yaml.MappingNode) -> None:
    """Refuse a mapping in which a key is there twice: the last would count, and nobody would notice."""
    lines: dict[str, int] = {}
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            continue
        line = key.start_mark.line + 1
        if key.value in lines:
            raise NotTaken(f"{shown(key.value)} is given twice, in line {lines[key.value]} and in line {line}")
        lines[key.value] = line


def shown(text: object) -> str:
    """Return what somebody wrote, fit for a sentence: on one line and not long."""
    line = one_line(str(text))
    return line if len(line) <= LONGEST_SHOWN else line[: LONGEST_SHOWN - 3] + "..."


def tags(part: object) -> bool:
    """Whether a part of a fault's path is no key, but says which alternative of a choice was meant."""
    return part in TAGS or is_tag(part)


def sentence(fault: Any, whole: type[BaseModel]) -> str:
    """Return a fault that validation found in a ``whole`` as a sentence: key, value, what is allowed."""
    path = [part for part in fault["loc"] if not tags(part)] or [part for part in fault["loc"][-1:] if not is_tag(part)]
    key = ".".join(map(shown, path)) or "the file"
    message = one_line(str(fault["msg"]))
    if fault["type"] == "extra_forbidden":
        allowed = list(_allowed_keys(fault["loc"][:-1], whole))
        close = difflib.get_close_matches(str(fault["loc"][-1]), allowed, 1)
        meant = f"did you mean {close[0]}? " if close else ""
        return f"{key} is not a known key; {meant}allowed here: {', '.join(sorted(allowed))}"
    if fault["type"] == EXPLAINED:
        return f"{key}: {message}"
    if fault["type"] == "missing":
        return f"{key} is missing"
    if fault["type"] == "value_error":
        text = message.removeprefix("Value error, ")
        return f"{key}: {text}" if fault["loc"] else text
    if fault["loc"] and fault["loc"][-1] == KEY:
        return f"{key.removesuffix('.' + KEY)} is no name: name it with letters; a number has a decimal point, no comma"
    if fault["type"] == "string_type" and isinstance(fault["input"], int | float):
        message += ", so write it in quotes"
    if fault["type"] in ("tuple_type", "list_type"):
        message = "expected a list in brackets, such as [100, 200]"
    value = "empty" if fault["input"] is None else _value(fault["input"])
    return f"{key} is {value}: {message[0].lower()}{message[1:]}"


def _value(value: object) -> str:
    """Return a value of the file as it is shown; only the beginning of one that would fill pages, or memory."""
    try:
        return shown(repr(value) if isinstance(value, str) else _SHORT.repr(value))
    except ValueError:
        return "a number of thousands of digits"


def _allowed_keys(path: tuple[Any, ...], whole: type[BaseModel]) -> Iterator[str]:
    """Keys of the section at ``path``."""
    model: Any = whole
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
    if is_tag(tag):
        return settings_of_tag(tag) if " " in tag else model
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


def line_of(node: Any, path: tuple[Any, ...]) -> int | None:
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
