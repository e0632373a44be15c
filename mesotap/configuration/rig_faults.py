"""Faults of a rig file: of a value that may be of several kinds, only what is wrong with the kind that was meant."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from rig.section import Section
from rig.written import EXPLAINED

BRANCHES = ("float", "int", "str")
STARTS = ("constrained", "function", "dict[", "literal[")
"""What validation adds, or begins with, to the path of a key where a value may be of several kinds."""
COLUMNS = ("channel", "frequency", "force", "amplitude", "phase")
TELLING = (EXPLAINED, "value_error", "finite_number", "greater_than", "extra_forbidden")
"""Faults with one kind of value that say more than that it is of none of the kinds."""
NO_CONSTANT = "is not a number, no {value, uncertainty}, nor 'unknown'"
NO_COLUMN = "names a column, or its number from 0"
OTHERWISE = dict.fromkeys(COLUMNS, NO_COLUMN) | {
    "of": "names a body, or gives bodies with their shares",
    "preload": "is not a force above 0 N, nor 'load'",
}
"""What is said, by key, of a value that is of none of the kinds."""


def deepest(error: ValidationError, content: object, kinds: Mapping[str, type[Section]]) -> list[dict[str, Any]]:
    """Return one fault a key: of a value that may be a number, a section or 'unknown' only what fits it best.

    Parameters
    ----------
    content
        What was validated.
    kinds
        Sections that a constant may be, each by a key that only it has; the last one is meant where there is none.
    """
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    sections = {kind.__name__: kind for kind in kinds.values()}
    faults: list[dict[str, Any]] = [dict(fault) for fault in error.errors()]
    for fault in faults:
        loc: tuple[Any, ...] = fault["loc"]
        if not _meant(loc, content, kinds):
            continue
        i = next((i for i, part in enumerate(loc) if i and _is_branch(part, sections)), len(loc))
        within = i + 1 < len(loc) and loc[i] in sections
        if within or (i < len(loc) and fault["type"] in TELLING and loc[i - 1] not in COLUMNS):
            best = {**fault, "loc": (*loc[:i], *loc[i + 1 :])}
            if within and fault["type"] == "extra_forbidden":
                allowed = ", ".join(sorted(sections[loc[i]].model_fields))
                best |= {"type": "branch", "msg": f"is not a known key; allowed here: {allowed}"}
            found.setdefault(("best", *loc[:i]), best)
        if i < len(loc):
            loc = loc[:i]
            fault = {**fault, "loc": loc, "type": "branch", "msg": OTHERWISE.get(loc[-1], NO_CONSTANT)}
        found.setdefault(loc, fault)
    emptied = {f["loc"] for f in found.values() if f["type"] == "too_short"}  # a list whose entries are at fault
    deeper = {loc for loc in emptied if any(f["loc"][: len(loc)] == loc != f["loc"] for f in found.values())}
    return [f for key, f in found.items() if ("best", *key) not in found and f["loc"] not in deeper]


def _is_branch(part: object, sections: Mapping[str, type[Section]]) -> bool:
    return isinstance(part, str) and (part in BRANCHES or part in sections or part.startswith(STARTS))


def _meant(loc: tuple[Any, ...], content: object, kinds: Mapping[str, type[Section]]) -> bool:
    """Whether a fault is not one with a section that is not meant."""
    at: Any = content
    last = list(kinds.values())[-1]
    for part in loc:
        try:
            at = at[part]
        except (LookupError, TypeError):
            meant = next((k for key, k in kinds.items() if isinstance(at, dict) and key in at), last)
            return part not in {kind.__name__ for kind in kinds.values()} or part == meant.__name__
    return True


def place_named(message: str, content: Mapping[Any, Any]) -> tuple[Any, ...]:
    """Return the path of the key that a fault of the whole file begins with; nothing where it begins with none.

    Examples
    --------
    >>> place_named("Value error, bodies.far: nothing holds it", {"bodies": {"far": 1, "near": 1}})
    ('bodies', 'far')
    >>> place_named("joints.0 names 'x', which is not a body", {"joints": [{"between": ["x", "ground"]}]})
    ('joints', 0)
    """
    said = message.removeprefix("Value error, ")
    for section, within in content.items():
        keys = list(within) if isinstance(within, dict) else range(len(within)) if isinstance(within, list) else ()
        named = [key for key in keys if re.match(rf"{re.escape(f'{section}.{key}')}(?=[:, ])", said)]
        if named:
            return section, max(named, key=lambda key: len(str(key)))
        if re.match(rf"{re.escape(str(section))}(?=[:., ])", said):
            return (section,)
    return ()
