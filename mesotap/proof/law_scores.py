"""How well laws are learned that nobody listed: scores of the sessions with one effect outside the list."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mesotap.proof.entries import CONSISTENT, MISSING, NEW, UNEXPLAINED, Entry, Named
from mesotap.proof.scores import CONFIDENT, Count, counted, grade

LEARNED_ERROR_ALLOWED = 1.05  # held-out error over that of the fit that knows
WEAKEST, STRONG = 30.0, 100.0
"""Grades from which an effect is to be noticed, and from which its law is to be right."""
OF_CHANNELS = ("sensor", "clock")
"""Kinds of laws that act in channels and not in elements."""


def hidden_law(e: Entry) -> Mapping[str, Any]:
    """Return what the truth states of the law of the first effect; empty where it states none."""
    laws: Sequence[Mapping[str, Any]] = e.truth.get("laws") or ({},)
    return laws[0]


def same(m: Named, e: Entry) -> bool:
    """Return whether a listed mechanism that is named, or one declared beside it, has the hidden effect's equations."""
    return not m.learned and bool({m.id, *m.alike} & {*e.effects, *hidden_law(e).get("same", ())})


def wrongly_stated(e: Entry) -> bool:
    """Return whether a listed mechanism of other equations is stated with more than `CONFIDENT`."""
    return any(m.probability > CONFIDENT and not m.learned and not same(m, e) for m in e.named)


def rightly_named(e: Entry) -> bool:
    """Return whether the first name is that of a listed mechanism of the very same equations."""
    return e.verdict == MISSING and e.first is not None and same(e.first, e)


def noticed(e: Entry) -> bool:
    """Return whether the verdict is that of physics outside the list, or names the same equations."""
    return e.verdict in (NEW, UNEXPLAINED) or rightly_named(e)


def placed(e: Entry) -> bool:
    """Return whether the element is right, or the channels of what happens there.

    Where an answer names neither, whether the class of the component is.
    """
    law = hidden_law(e)
    right = set(law.get("elements", ()))
    if law.get("kind") in OF_CHANNELS:
        said = {channel for name in (e.element, *e.channels) if name for channel in name.split("-")}  # of A-B both
        return said <= right if said else e.located in e.components
    if e.element:
        return e.element in right
    return e.located in {*e.components, *law.get("components", ())}


def of_right_kind(e: Entry) -> bool:
    """Return whether the law that was learned first is of the right kind, or the same equations are named."""
    learned = next((m for m in e.named if m.learned), None)
    return rightly_named(e) or (learned is not None and learned.kind == hidden_law(e).get("kind"))


def as_good(e: Entry) -> bool:
    """Return whether the held-out error is near that of the fit that knows."""
    ratio = e.heldout_rms / e.knowing_rms if e.knowing_rms > 0 else math.nan
    return ratio <= LEARNED_ERROR_ALLOWED


def exponents(e: Entry) -> list[bool]:
    """Return for each exponent with an interval and a true value whether the one holds the other."""
    true = hidden_law(e).get("exponents", {})
    learned = [m for m in e.named if m.learned][:1]
    return [low <= true[k] <= high for m in learned for k, (low, high) in m.exponents.items() if k in true]


@dataclass(frozen=True, slots=True)
class Goal:
    """One share, of which sessions it is in words, and the goal for it."""

    name: str
    of: str
    reached: Count
    goal: float


def goals(entries: Sequence[Entry]) -> list[Goal]:
    """Score the sessions with an effect outside the list against the goals, over all of its kinds."""
    mine = [e for e in entries if e.kind == "outside"]
    noticeable = [e for e in mine if grade(e.d) >= WEAKEST]
    located = [e for e in noticeable if e.verdict != CONSISTENT]
    strong = [e for e in mine if grade(e.d) >= STRONG]
    stated = counted(x for e in mine for x in exponents(e))
    return [
        Goal("no name of other equations stated with more than 0.9", "all", _count(mine, _not_wrongly_stated), 0.99),
        Goal("`new_physics`, `unexplained` or the same equations named", "d >= 30", _count(noticeable, noticed), 0.9),
        Goal("element or channel right", "d >= 30 and not `consistent`", _count(located, placed), 0.9),
        Goal("kind of the law right", "d >= 100", _count(strong, of_right_kind), 0.8),
        Goal("held-out error within 1.05 of the fit that knows", "d >= 100", _count(strong, as_good), 0.8),
        Goal("95 % interval holds the exponent", "exponents stated", stated, 0.9),
    ]


def _count(entries: Sequence[Entry], test: Callable[[Entry], bool]) -> Count:
    return counted(test(e) for e in entries)


def _not_wrongly_stated(e: Entry) -> bool:
    return not wrongly_stated(e)


@dataclass(frozen=True, slots=True)
class OfEffect:
    """What was said of one effect at one grade, in sessions.

    ``named`` counts `missing_physics` with a listed mechanism of the same equations first, ``otherwise`` with another.
    """

    effect: str
    grade: float
    sessions: int
    new: int
    unexplained: int
    named: int
    otherwise: int
    consistent: int
    wrongly_stated: int
    placed: int
    of_right_kind: int
    as_good: int


def of_effects(entries: Sequence[Entry]) -> list[OfEffect]:
    """Count what was said of each effect outside the list at each grade."""
    mine = [e for e in entries if e.kind == "outside"]
    out = []
    for effect, g in sorted({(e.effects[0], grade(e.d)) for e in mine}):
        here = [e for e in mine if e.effects[0] == effect and grade(e.d) == g]

        def how_many(test: Callable[[Entry], bool], here: list[Entry] = here) -> int:
            return sum(map(test, here))

        out.append(
            OfEffect(
                effect,
                g,
                len(here),
                new=how_many(lambda e: e.verdict == NEW),
                unexplained=how_many(lambda e: e.verdict == UNEXPLAINED),
                named=how_many(rightly_named),
                otherwise=how_many(lambda e: e.verdict == MISSING and not rightly_named(e)),
                consistent=how_many(lambda e: e.verdict == CONSISTENT),
                wrongly_stated=how_many(wrongly_stated),
                placed=how_many(placed),
                of_right_kind=how_many(of_right_kind),
                as_good=how_many(as_good),
            )
        )
    return out


@dataclass(frozen=True, slots=True)
class FalseLaws:
    """Where no law is to be learned: sessions in which nothing, or one listed mechanism, is hidden."""

    of_nothing: Count
    of_listed: Count


def false_laws(entries: Sequence[Entry]) -> FalseLaws:
    """Count the laws learned of nothing and of listed mechanisms."""
    learned = {kind: counted(e.verdict == NEW for e in entries if e.kind == kind) for kind in ("null", "single")}
    return FalseLaws(learned["null"], learned["single"])
