"""What a process that reads foreign files answers: JSON for the structure, plain bytes for the arrays.

Nothing in an answer can make the program that asked run anything: it holds JSON, float64 arrays, and dataclasses of the
kinds that were asked for.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_ITEM = "<f8"


class NoReply(ValueError):
    """An answer is none."""


def encoded(value: Any, arrays: list[Array]) -> Any:
    """Return ``value`` as JSON types, its arrays put aside into ``arrays``.

    A container becomes a pair of its kind and its content; a dict, which holds JSON types alone, one text.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        arrays.append(np.ascontiguousarray(value, dtype=_ITEM))
        return ["array", len(arrays) - 1]
    if isinstance(value, list | tuple):
        return [type(value).__name__, [encoded(item, arrays) for item in value]]
    if isinstance(value, dict):
        if any(isinstance(item, np.ndarray) for item in value.values()):
            return ["arrays", [[key, encoded(item, arrays)] for key, item in value.items()]]
        return ["json", json.dumps(value)]
    if dataclasses.is_dataclass(value):
        items = {f.name: encoded(getattr(value, f.name), arrays) for f in dataclasses.fields(value)}
        return [type(value).__name__, items]
    raise TypeError(f"a {type(value).__name__} cannot be answered")


def decoded(value: Any, arrays: Sequence[Array], kinds: Mapping[str, type]) -> Any:
    """Return what was `encoded`; ``kinds`` are the dataclasses that may be in it, by name.

    Raises
    ------
    NoReply
        It holds something else.
    """
    if not isinstance(value, list):
        return value
    try:
        kind, content = value
        if kind == "array":
            return arrays[content]
        if kind in ("list", "tuple"):
            items = [decoded(item, arrays, kinds) for item in content]
            return items if kind == "list" else tuple(items)
        if kind == "arrays":
            return {key: decoded(item, arrays, kinds) for key, item in content}
        if kind == "json":
            return json.loads(content)
        return kinds[kind](**{name: decoded(item, arrays, kinds) for name, item in content.items()})
    except NoReply:
        raise
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        raise NoReply(str(error)) from error


def shapes(arrays: Sequence[Array]) -> list[list[int]]:
    """Return the shapes of arrays as JSON types."""
    return [list(array.shape) for array in arrays]


def empty_arrays(shapes: Any, most_bytes: int) -> list[Array]:
    """Return arrays to be filled, of shapes that an answer claims.

    Raises
    ------
    NoReply
        The shapes are none, or together larger than ``most_bytes``.
    """
    total = 0
    for shape in shapes if isinstance(shapes, list) else [None]:
        if not isinstance(shape, list) or any(type(n) is not int or n < 0 for n in shape):
            raise NoReply("a shape is none")
        size = 8
        for n in shape:
            size *= n
        total += size
    if total > most_bytes:
        raise NoReply(f"{total} bytes are more than {most_bytes}")
    return [np.empty(shape, dtype=_ITEM) for shape in shapes]
