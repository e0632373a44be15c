"""What is asked of the catalogue, in one line: ``specimen:steel load:300..500 -verdict:consistent (kc:5.. or "worn")``.

Terms that stand side by side all have to hold; ``or`` between them asks for one, a minus or ``not`` before a term for
the opposite. A word without a key is looked for in all texts. The options of the command line become the same terms.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from daq.errors import one_line
from mesotap.catalogue.entry import STATES, VERDICTS
from rig.errors import MesotapError

TEXTS = {
    "specimen": ("specimen",),
    "material": ("specimen", "title"),
    "operator": ("operator",),
    "title": ("title",),
    "name": ("name",),
    "text": (),
}
"""Texts in which a term's words are looked for; all of them where none is named. A session names no material of its
own: labs write it into specimen or title."""

EXACT = ("verdict", "mechanism", "state", "software")
ALLOWED = {"state": STATES, "verdict": VERDICTS}
"""Values of those keys that have no others: what is not among them is a slip, and would find nothing."""

SWITCHES = ("drifted", "simulated")
OF_SESSION = {"noise": 1.0, "f1": 1.0}
OF_LOAD = {"load": 1.0, "kc": 1e6, "zeta": 1e-2, "f2": 1.0}
"""Ranges of one load, by the unit that people write over the one that is kept: mN; MN/m, which is N/um; %; Hz."""

RANGES = {**OF_SESSION, **OF_LOAD}
DATES = ("since", "until")
KEYS = (*TEXTS, *EXACT, *SWITCHES, *RANGES, *DATES)
YES, NO = ("yes", "true", "1"), ("no", "false", "0")
DEEPEST = 50
LONGEST = 10_000  # characters
ROUNDED = 1e-9  # relative; a bound written in percent is no other number for its last bit

_TOKEN = re.compile(r'\s*(?:(?P<bracket>[()])|(?P<minus>-(?=\S))|(?P<term>(?:[a-z_0-9]+:)?"[^"]*"|[^\s()"]+))', re.I)
_DAY = re.compile(r"\d{4}-\d{2}-\d{2}")


class QuestionError(MesotapError, ValueError):
    """A question that cannot be answered; one sentence."""

    def __init__(self, text: str) -> None:
        super().__init__(one_line(text))


@dataclass(frozen=True, slots=True)
class Words:
    """Words that stand in one of the columns, in any where there are none."""

    columns: tuple[str, ...]
    text: str


@dataclass(frozen=True, slots=True)
class Is:
    """A value that is exactly this."""

    key: str
    value: str | bool


@dataclass(frozen=True, slots=True)
class Within:
    """A number or time (seconds since 1970) from ``low`` to ``high``, both included."""

    key: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class All:
    """Every one holds."""

    parts: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class OneOf:
    """One of them holds at least."""

    parts: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Not:
    """It does not hold."""

    part: Node


Node = Words | Is | Within | All | OneOf | Not
EVERYTHING = All(())


def asked(where: str = "", options: Mapping[str, str | None] | None = None) -> Node:
    """Return what an expression and options ask for together.

    Parameters
    ----------
    where
        An expression.
    options
        Values by key, as in `KEYS`; None for what was not asked.

    Raises
    ------
    QuestionError
        One of them cannot be understood.

    Examples
    --------
    >>> asked("load:300..500").parts[0].high
    500.0
    """
    given = tuple(term(key, value) for key, value in (options or {}).items() if value is not None)
    return All((*given, *parsed(where).parts))


def parsed(where: str) -> All:
    """Return what an expression asks for.

    Raises
    ------
    QuestionError
        It cannot be understood.
    """
    if len(where) > LONGEST:
        raise QuestionError(f"--where: is longer than {LONGEST} characters")
    reader = _Reader(where, _tokens(where))
    found = reader.alternatives(0)
    if reader.left():
        raise QuestionError(f"--where {where}: a bracket closes that was never opened")
    return found if isinstance(found, All) else All((found,))


def term(key: str, value: str) -> Node:
    """Return what one key and its value ask for.

    Raises
    ------
    QuestionError
        There is no such key, or the value is none of its kind.
    """
    if key in TEXTS:
        if not any(c.isalnum() for c in value):
            raise QuestionError(f"{key}: needs a word to look for")
        return Words(TEXTS[key], value)
    if key in SWITCHES:
        if value.lower() not in (*YES, *NO):
            raise QuestionError(f"{key}: takes yes or no, not {value!r:.40}")
        return Is(key, value.lower() in YES)
    if key in EXACT:
        if key in ALLOWED and value not in ALLOWED[key]:
            raise QuestionError(f"{key}: is one of {', '.join(ALLOWED[key])}, not {value!r:.40}")
        return Is(key, value)
    if key in DATES:
        return _date(key, value)
    if key in RANGES:
        return _range(key, value)
    raise QuestionError(f"{key!r:.40} is nothing to ask for; there are {', '.join(KEYS)}")


def _range(key: str, value: str) -> Within:
    low, dots, high = value.partition("..")
    try:
        ends = [float(low) if low else -math.inf, float(high) if high else math.inf]
        if not dots:
            ends[1] = ends[0]
        if math.isnan(ends[0]) or math.isnan(ends[1]) or not (low or high):
            raise ValueError
    except ValueError as error:
        unit = {"load": "mN", "kc": "MN/m", "zeta": "%", "noise": "m/s2"}.get(key, "Hz")
        raise QuestionError(
            f"{key}: takes a number or a range such as 3..5, 3.. or ..5, in {unit}, not {value!r:.40}"
        ) from error
    if ends[0] > ends[1]:
        raise QuestionError(f"{key}: the range {value!r:.40} ends before it begins")
    scaled = [end * RANGES[key] for end in ends]
    if not dots:
        room = 0.5 * 10.0 ** -len(value.partition(".")[2]) * RANGES[key]  # 300 is what rounds to 300
        return Within(key, scaled[0] - room, scaled[1] + room)
    return Within(key, scaled[0] - ROUNDED * abs(scaled[0]) if math.isfinite(scaled[0]) else scaled[0], scaled[1])


def _date(key: str, value: str) -> Within:
    try:
        at = datetime.fromisoformat(value)
    except ValueError:
        raise QuestionError(f"{key}: takes a date such as 2026-03-01, not {value!r:.40}") from None
    at = at if at.tzinfo else at.replace(tzinfo=UTC)
    if key == "since":
        return Within("created", at.timestamp(), math.inf)
    end = at.timestamp()
    if _DAY.fullmatch(value):
        end += timedelta(days=1).total_seconds() - 1e-6  # the whole of that day
    return Within("created", -math.inf, end)


def _tokens(where: str) -> list[str]:
    found, place = [], 0
    while where[place:].strip():
        match = _TOKEN.match(where, place)
        if match is None:
            raise QuestionError(f"--where {where}: a quotation mark opens and does not close")
        found.append(match.group().strip())
        place = match.end()
    return found


class _Reader:
    """Descends through brackets, ``or``, neighbours and ``not``."""

    def __init__(self, where: str, tokens: list[str]) -> None:
        self._where, self._tokens, self._at = where, tokens, 0

    def left(self) -> bool:
        return self._at < len(self._tokens)

    def _next_is(self, *words: str) -> bool:
        return self.left() and self._tokens[self._at].lower() in words

    def alternatives(self, depth: int) -> Node:
        if depth > DEEPEST:
            raise QuestionError(f"--where: brackets within brackets, more than {DEEPEST} of them")
        parts = [self._neighbours(depth)]
        while self._next_is("or"):
            self._at += 1
            parts.append(self._neighbours(depth))
        if len(parts) > 1 and any(part == EVERYTHING for part in parts):
            raise QuestionError(f"--where {self._where}: 'or' needs something on both sides")
        return parts[0] if len(parts) == 1 else OneOf(tuple(parts))

    def _neighbours(self, depth: int) -> All:
        parts = []
        while self.left() and not self._next_is("or", ")"):
            if self._next_is("and"):
                self._at += 1
                continue
            parts.append(self._one(depth))
        return All(tuple(parts))

    def _one(self, depth: int) -> Node:
        if depth > DEEPEST:
            raise QuestionError(f"--where: brackets within brackets, more than {DEEPEST} of them")
        if self._next_is("-", "not"):
            self._at += 1
            if not self.left() or self._next_is("or", "and", ")"):
                raise QuestionError(f"--where {self._where}: 'not' needs something after it")
            return Not(self._one(depth + 1))
        if self._next_is("("):
            self._at += 1
            within = self.alternatives(depth + 1)
            if not self._next_is(")"):
                raise QuestionError(f"--where {self._where}: a bracket opens and does not close")
            self._at += 1
            return within
        token = self._tokens[self._at]
        self._at += 1
        key, colon, value = token.partition(":")
        if token.startswith('"') or not colon:
            return term("text", token.strip('"'))
        return term(key.lower(), value.strip('"'))
