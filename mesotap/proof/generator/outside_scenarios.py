"""Sessions with effects outside the list alone, and five effects that a seed holds back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mesotap.proof.generator.effects import LISTED, OUTSIDE
from mesotap.proof.generator.scenarios import NULL_WEIGHTS, NULLS, STRONG_GRADES, Scenario, cycle

SIZE = (6, 8)
"""Loads, and taps at each."""
TEN = ("outside",) * 8 + ("null", "single")
"""Kinds of ten sessions."""
HELD_BACK = 5


def held_back(seed: int) -> tuple[str, ...]:
    """Return the five effects that a seed holds back, each of another kind of law."""
    rng = np.random.default_rng([seed, 5])
    of_kind: dict[str, list[str]] = {}
    for name, effect in OUTSIDE.items():
        if effect.nature is not None:
            of_kind.setdefault(effect.nature.kind, []).append(name)
    kinds = rng.choice(sorted(of_kind), HELD_BACK, replace=False)
    return tuple(sorted(str(rng.choice(of_kind[str(kind)])) for kind in kinds))


def draw(seed: int, sessions: int, only: str | None, size: tuple[int, int], names: Sequence[str]) -> list[Scenario]:
    """Draw sessions with one of the effects ``names`` each, and nulls and listed effects now and then.

    Every effect comes equally often at each of `STRONG_GRADES`; ``only`` makes all sessions of one of the kinds of
    `TEN`.
    """
    rng = np.random.default_rng([seed, 6])
    pairs = {
        "outside": cycle(rng, [(name, d) for name in names for d in STRONG_GRADES]),
        "single": cycle(rng, [(name, d) for name in LISTED for d in STRONG_GRADES]),
    }
    scenarios: list[Scenario] = []
    while len(scenarios) < sessions:
        for kind in rng.permutation(np.array(TEN if only is None else (only,))).tolist():
            number = len(scenarios)
            if kind == "null":
                variety = str(rng.choice(NULLS, p=NULL_WEIGHTS))
                scenarios.append(Scenario(number, kind, variety=variety, size=size))
            else:
                name, d = next(pairs[kind])
                scenarios.append(Scenario(number, kind, (name,), (d,), size=size))
    return scenarios[:sessions]
