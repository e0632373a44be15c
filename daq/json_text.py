"""JSON from outside, in which no key may be given twice: the last would count, and nobody would notice."""

from __future__ import annotations

import json
from typing import Any

LONGEST_SHOWN = 40


class GivenTwice(ValueError):
    """A key is given twice; the text says which."""


def parsed_once(text: str | bytes) -> Any:
    """Return what a JSON text holds.

    Raises
    ------
    GivenTwice
        One of its objects has a key twice.
    ValueError, RecursionError
        It is not JSON, or nested too deeply.
    """
    return json.loads(text, object_pairs_hook=_once)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise GivenTwice(f"{twice[:LONGEST_SHOWN]!r} is given twice")
    return found
