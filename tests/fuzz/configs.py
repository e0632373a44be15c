"""Whatever stands in config.yaml, it is taken or refused in sentences."""

from __future__ import annotations

import datetime
import re
from pathlib import Path
from typing import Any

import yaml

from mesotap.configuration.config import Config, ConfigError, default_text, effective_text, load_config, parse_config
from tests.fuzz.mutations import Damage, damaged, damages
from tests.fuzz.source import Source, Target

COMMENT = re.compile(r"(^|\s+)#.*")
LINES = [COMMENT.sub("", line) for line in default_text().splitlines()]
DEFAULT = "".join(f"{line}\n" for line in LINES if line)  # what is damaged should matter
SCALARS = (0, 1, -1, 1e-300, 1e300, 10**400, "", "simulated", "hand", "motor", "usb-1608fs-plus", "1e5", "[]")
DEEPEST = 3


def places(node: object, path: tuple = ()) -> list[tuple]:
    """Every key of a mapping, and every place of a list, however deep."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [path, *(place for key, inner in items for place in places(inner, (*path, key)))]


WHOLE = yaml.safe_load(effective_text(parse_config(DEFAULT)))
PLACES = [place for place in places(WHOLE)[1:] if all(isinstance(key, str) for key in place)]

Edits = list[tuple[tuple, Any]]


def scalar(source: Source) -> Any:
    kind = source.integer(0, 7)
    if kind == 0:
        return source.choice((None, True, False))
    if kind == 1:
        return source.integer(-(2**70), 2**70)
    if kind == 2:
        return source.number()
    if kind == 3:
        return source.text(12)
    if kind == 4:
        return datetime.date.fromordinal(source.integer(1, datetime.date.max.toordinal()))
    return source.content(4) if kind == 5 else source.choice(SCALARS)


def likely(source: Source) -> Any:
    """What could stand there: numbers of every size, small counts, words that mean something somewhere."""
    kind = source.integer(0, 2)
    if kind == 0:
        return source.integer(1, 9999) * 10.0 ** source.integer(-40, 40)
    return source.integer(0, 30) if kind == 1 else source.choice((*SCALARS, True, False))


def value(source: Source, depth: int = 0) -> Any:
    """Anything that YAML can say: a scalar, a list, or a mapping with keys of any kind."""
    kind = source.integer(0, 7) if depth < DEEPEST else 0
    if kind > 3:
        return likely(source)

    def inner(source: Source) -> Any:
        return value(source, depth + 1)

    if kind < 2:
        return scalar(source)
    if kind == 2:
        return source.several(inner, 0, 4)
    return dict(source.several(lambda source: (scalar(source), inner(source)), 0, 3))


def edits(source: Source) -> Edits:
    return source.several(lambda source: (source.choice(PLACES), value(source)), 1, 3)


def put(whole: object, place: tuple, value: object) -> object:
    """The configuration with another value at one place."""
    if not place:
        return value
    if isinstance(whole, list) and place[0] in range(len(whole)):
        return [put(inner, place[1:], value) if i == place[0] else inner for i, inner in enumerate(whole)]
    if not isinstance(whole, dict):
        return value
    return {**whole, place[0]: put(whole.get(place[0], {}), place[1:], value)}


def taken_or_refused(text: str, changes: tuple[str, ...] = ()) -> None:
    try:
        config = parse_config(text, "some.yaml", changes)
    except ConfigError as error:
        assert str(error)
        for line in str(error).splitlines():
            assert line.startswith(("some.yaml", "--set")), line
            assert len(line) < 2000
        return
    assert isinstance(config, Config)
    assert parse_config(effective_text(config)) == config


def any_text(place: Path) -> Target:
    return Target(lambda source: source.text(200), taken_or_refused)


def damaged_configuration(place: Path) -> Target:
    def check(damage: Damage) -> None:
        taken_or_refused(damaged(DEFAULT.encode(), damage).decode("utf-8", "replace"))

    return Target(damages(8), check)


def any_value_at_any_key(place: Path) -> Target:
    """What is not said is the default, so a file of the edited keys is a default file edited."""

    def check(edits: Edits) -> None:
        content: object = {}
        for at, other in edits:
            content = put(content, at, other)
        try:
            text = yaml.safe_dump(content, allow_unicode=True)
        except (yaml.YAMLError, TypeError, ValueError):  # keys that cannot be sorted, or integers too long to print
            return
        taken_or_refused(text)

    return Target(edits, check)


def any_setting_on_the_command_line(place: Path) -> Target:
    def draw(source: Source) -> str:
        if source.integer(0, 3) == 0:
            return source.text(30)
        return f"{'.'.join(source.choice(PLACES))}={source.text(20)}"

    return Target(draw, lambda change: taken_or_refused("", (change,)))


def any_bytes_in_the_file(place: Path) -> Target:
    path = place / "some.yaml"

    def draw(source: Source) -> bytes | Damage:
        return source.content(80) if source.integer(0, 1) else damages(3)(source)

    def check(drawn: bytes | Damage) -> None:
        path.write_bytes(drawn if isinstance(drawn, bytes) else damaged(DEFAULT.encode(), drawn))
        try:
            load_config(path)
        except ConfigError as error:
            assert str(path) in str(error)

    return Target(draw, check)


TARGETS = (
    any_text,
    damaged_configuration,
    any_value_at_any_key,
    any_setting_on_the_command_line,
    any_bytes_in_the_file,
)
