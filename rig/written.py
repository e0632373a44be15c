"""Numbers and truth values as people write them: what would be taken for another value is refused, not taken."""

from __future__ import annotations

import re
import reprlib
from typing import Any

from pydantic_core import PydanticCustomError, core_schema

NUMBER = re.compile(r"[-+]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
"""A number whose value nobody can mistake: without leading zeros, underscores or colons."""

EXPLAINED = "explained"
"""Type of a fault whose message is a whole sentence but for the key."""

_LEADING_ZEROS = re.compile(r"([-+]?)0+([0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?)")
_WITH_UNDERSCORES = re.compile(r"[-+]?[0-9]+(?:_[0-9]+)+(?:\.[0-9]*)?")
_OTHER_BASE = re.compile(r"[-+]?0(?:[xX][0-9a-fA-F]+|[bB][01]+|[oO][0-7]+)")
_LONGEST = 40  # characters of a number whose other way to be written is told


def how_to_write(text: str) -> str:
    """Return in a sentence how something that resembles a number is to be written."""
    meant = _meant(text) if len(text) <= _LONGEST else ""
    return f"{text} is not written like a number: write " + (
        meant or "digits with at most one point, such as 600 or 0.6"
    )


def _meant(text: str) -> str:
    leading = _LEADING_ZEROS.fullmatch(text)
    if leading:
        return leading[1].replace("+", "") + leading[2]
    if _WITH_UNDERSCORES.fullmatch(text):
        return text.replace("_", "").lstrip("+")
    return str(int(text, 0)) if _OTHER_BASE.fullmatch(text) else ""


def as_written(schema: Any) -> Any:
    """Return the core schema of a section whose numbers take no text but plain numbers, and whose kinds do not mix.

    Pydantic takes true for 1, ``yes`` and 1 for true, and ``1_000`` for 1000. The sections within look to themselves.
    """
    return _walked(schema, own=True)


def _walked(node: Any, own: bool = False) -> Any:
    if isinstance(node, list | tuple):
        return type(node)(_walked(part, own) for part in node)
    if not isinstance(node, dict):
        return node
    kind = node.get("type")
    if kind in ("int", "float") or (kind == "literal" and any(type(e) is int for e in node["expected"])):
        return core_schema.no_info_before_validator_function(number, node)
    if kind == "bool":
        return core_schema.no_info_before_validator_function(boolean, node)
    if kind == "model" and not own:
        return node
    inside = own and kind != "model"
    return {key: value if key in _NO_SCHEMAS else _walked(value, inside) for key, value in node.items()}


_NO_SCHEMAS = ("metadata", "default", "cls", "config", "expected", "serialization")


def number(value: Any) -> Any:
    """Return what is given for a number, if it cannot be mistaken."""
    if isinstance(value, bool):
        raise _fault(f"{str(value).lower()} is not a number, and a number belongs here")
    if isinstance(value, str) and not NUMBER.fullmatch(value) and _resembles(value):
        raise _fault(how_to_write(value if len(value) <= _LONGEST else value[:_LONGEST] + "..."))
    return value


def boolean(value: Any) -> Any:
    """Return what is given for a truth value, if it is one."""
    if isinstance(value, bool):
        return value
    if value in ("true", "false"):
        raise _fault(f"{value!r} is text: write {value} without quotes")
    shown = repr(value[:_LONGEST]) if isinstance(value, str) else reprlib.repr(value)
    raise _fault(f"{shown} is neither true nor false: write one of these two")


def _resembles(text: str) -> bool:
    """Whether text would be taken for a number, or was meant as one."""
    try:
        float(text)
    except ValueError:
        return any(c.isdigit() for c in text)
    return True


def _fault(text: str) -> PydanticCustomError:
    return PydanticCustomError(EXPLAINED, "{said}", {"said": text})
