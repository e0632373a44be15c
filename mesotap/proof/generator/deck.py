"""Which sessions a proof is made of, in which order, and the making of each from the proof's seed and its number."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from daq.session_file import write_session
from mesotap.proof.generator.concealed import Concealed, conceal, record, surviving, truth
from mesotap.proof.generator.effects import LISTED, OUTSIDE, Effect
from mesotap.proof.generator.plan import random_plan
from mesotap.proof.generator.survival import alike

KINDS = ("null", "single", "two", "struck", "outside")
HAND = ("null", "single", "null", "single", "two", "null", "single", "struck", "null", "single", "outside", "single")
"""What a dozen sessions hold."""
GRADES = (3.0, 10.0, 30.0, 100.0, 300.0)
STRONG_GRADES = (30.0, 100.0, 300.0)
PAIR_GRADES = (30.0, 100.0)
FORCE_RATIO_TO_PART = 0.4
NULLS = ("exact", "declared wrongly", "undeclared filter", "load drift")
NULL_WEIGHTS = (0.4, 0.4, 0.1, 0.1)
UNDECLARED_HZ = (3000.0, 8000.0)
LARGEST_DRIFT_N = 2e-3
CHARACTERS = 4  # in which a look-alike is tried

STIFFNESS_LAWS = {"hertz_stiffness", "rough_surface_stiffness", "contact_loss"}
LOWER_SPRING = {"frame_compliance", "tube_spring_damping", "tube_spring_cubic"}
NEVER_TOGETHER = (STIFFNESS_LAWS, LOWER_SPRING)


@dataclass(frozen=True, slots=True)
class Card:
    """What one session is to hold.

    Attributes
    ----------
    number
        Place in the proof, from 0.
    kind
        One of `KINDS`.
    effects
        Names of what is concealed, and ``d`` of each.
    variety
        Of a null: one of `NULLS`.
    """

    number: int
    kind: str
    effects: tuple[str, ...] = ()
    d: tuple[float, ...] = ()
    variety: str = ""

    @property
    def name(self) -> str:
        """Name of the session's file, without its ending."""
        return f"session-{self.number:04d}"


def deal(seed: int, sessions: int, only: str | None = None) -> list[Card]:
    """Return the cards of a proof: every dozen has the kinds of `HAND`, every effect and grade comes equally often.

    ``only`` makes all sessions of one kind.
    """
    hand = HAND if only is None else (only,)
    rng = np.random.default_rng([seed, 0])
    singles = _cycle(rng, [(e, d) for e in LISTED for d in GRADES])
    struck = _cycle(rng, [(e, d) for e in LISTED for d in STRONG_GRADES])
    outside = _cycle(rng, [(e, d) for e in OUTSIDE for d in STRONG_GRADES])
    cards: list[Card] = []
    while len(cards) < sessions:
        for kind in rng.permutation(np.array(hand)).tolist():
            number = len(cards)
            if kind == "null":
                cards.append(Card(number, kind, variety=str(rng.choice(NULLS, p=NULL_WEIGHTS))))
            elif kind == "two":
                pair = _pair(rng)
                cards.append(Card(number, kind, pair, tuple(float(d) for d in rng.choice(PAIR_GRADES, 2))))
            else:
                effect, d = next({"single": singles, "struck": struck, "outside": outside}[kind])
                cards.append(Card(number, kind, (effect,), (d,)))
    return cards[:sessions]


def _cycle(rng: np.random.Generator, pairs: list[tuple[str, float]]) -> Any:
    """Yield the pairs in a shuffled order, again and again."""
    while True:
        for i in rng.permutation(len(pairs)).tolist():
            yield pairs[i]


def _pair(rng: np.random.Generator) -> tuple[str, str]:
    """Draw two effects of different components that can stand side by side."""
    while True:
        a, b = (str(e) for e in rng.choice(list(LISTED), 2, replace=False))
        apart = LISTED[a].component != LISTED[b].component
        if apart and not any({a, b} <= group for group in NEVER_TOGETHER):
            return a, b


def make(seed: int, card: Card, folder: Path) -> dict[str, Any]:
    """Make the session of a card, write its file into ``folder``, and return the truth of it."""
    rng = np.random.default_rng([seed, 1, card.number])
    concealed = _concealed(rng, card)
    d = surviving(concealed).d if concealed.hidden or card.variety in NULLS[2:] else 0.0
    recorded = record(rng, concealed, card.number)
    write_session(folder / f"{card.name}.h5", recorded.session)
    known = truth(concealed, d, recorded.knowing_rms)
    struck = card.effects[0] if card.kind == "struck" else None
    return {"kind": card.kind, "variety": card.variety, "asked_d": list(card.d), "without": struck, **known}


def _concealed(rng: np.random.Generator, card: Card) -> Concealed:
    if card.kind == "null":
        exact = card.variety == NULLS[0]
        plan = random_plan(rng, exact=exact)
        if card.variety == NULLS[2]:
            return Concealed(plan, undeclared_hz=float(rng.uniform(*UNDECLARED_HZ)))
        if card.variety == NULLS[3]:
            return Concealed(plan, drift_n=float(rng.uniform(-1, 1) * LARGEST_DRIFT_N))
        return Concealed(plan)
    # those that grade the taps come first: the rest builds on them
    effects = sorted((effect_named(e) for e in card.effects), key=lambda e: not e.fixed)
    grades = dict(zip(card.effects, card.d, strict=True))
    exponent = next((e.exponent for e in effects if e.exponent is not None), None)
    parts = any(e.id == "contact_loss" for e in effects)
    plan = random_plan(rng, exponent=exponent, force_ratio=FORCE_RATIO_TO_PART if parts else None)
    concealed = Concealed(plan)
    for effect in effects:
        character = effect.draw(rng, concealed.plan)
        concealed = conceal(concealed.plan, effect, character, grades[effect.id], concealed.hidden)
    return graded_anew(concealed) if len(effects) > 1 else concealed


def graded_anew(concealed: Concealed) -> Concealed:
    """Return the session with the ``d`` of each effect alone, in the plan as it has become."""
    plan = concealed.plan
    hidden = tuple(replace(h, d=surviving(Concealed(plan, (h,))).d) for h in concealed.hidden)
    return replace(concealed, hidden=hidden)


def effect_named(name: str) -> Effect:
    """Return an effect of either list."""
    return LISTED[name] if name in LISTED else OUTSIDE[name]


def likeness(seed: int, card: Card, name: str) -> float:
    """Return the largest cosine between what survives of a session's effects and what would of another one.

    The other effect is tried with several characters, at the same ``d``.
    """
    rng = np.random.default_rng([seed, 1, card.number])
    concealed = _concealed(rng, card)
    plan, true = concealed.plan, surviving(concealed)
    other = effect_named(name)
    largest = 0.0
    for _ in range(CHARACTERS):
        rival = conceal(plan, other, other.draw(rng, plan), true.d)
        # an effect that was graded by louder taps is held against the others at the taps that were
        same = replace(rival, plan=plan)
        largest = max(largest, alike(true, surviving(same)))
    return largest
