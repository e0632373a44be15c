"""Scenarios of a blind validation: which sessions it holds, and how each is made from the seed and its number."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from daq.session_file import write_session
from mesotap.proof.generator.concealed import Concealed, Hidden, conceal, record, surviving, truth
from mesotap.proof.generator.effect import Effect
from mesotap.proof.generator.effects import LISTED, OUTSIDE
from mesotap.proof.generator.hidden import HIDDEN
from mesotap.proof.generator.plan import Plan, random_plan
from mesotap.proof.generator.survival import alike

KINDS = ("null", "single", "two", "excluded", "outside")
DOZEN = ("null", "single", "null", "single", "two", "null", "single", "excluded", "null", "single", "outside", "single")
"""Kinds of a dozen sessions."""
GRADES = (3.0, 10.0, 30.0, 100.0, 300.0)
STRONG_GRADES = (30.0, 100.0, 300.0)
PAIR_GRADES = (30.0, 100.0)
FORCE_RATIO_TO_PART = 0.4
NULLS = ("exact", "declared wrongly", "undeclared filter", "load drift", *HIDDEN)
NULL_WEIGHTS = (0.35, 0.35, 0.05, 0.05, *[0.2 / len(HIDDEN)] * len(HIDDEN))
UNDECLARED_HZ = (3000.0, 8000.0)
LARGEST_DRIFT_N = 2e-3
CHARACTERS = 4  # with which a look-alike is tried

STIFFNESS_LAWS = {"hertz_stiffness", "rough_surface_stiffness", "contact_loss"}
LOWER_SPRING = {"frame_compliance", "base_motion", "tube_spring_damping", "tube_spring_cubic"}
TOLD_AS_ANOTHER = {"base_motion", "cable_drag", "normal_tangential_coupling", "upper_roll"}
"""Effects of the same equations as another one, which is named for both: without them nothing is missing."""
NEVER_TOGETHER = (STIFFNESS_LAWS, LOWER_SPRING)


@dataclass(frozen=True, slots=True)
class Scenario:
    """What one session is to contain.

    Attributes
    ----------
    number
        Index of the session, from 0.
    kind
        One of `KINDS`.
    effects
        Names of the concealed effects, and ``d`` of each.
    variety
        Of a null session: one of `NULLS`.
    size
        How many loads and how many taps at each; drawn where it is None.
    """

    number: int
    kind: str
    effects: tuple[str, ...] = ()
    d: tuple[float, ...] = ()
    variety: str = ""
    size: tuple[int, int] | None = None

    @property
    def name(self) -> str:
        """Name of the session's file, without its ending."""
        return f"session-{self.number:04d}"


def draw_scenarios(seed: int, sessions: int, only: str | None = None) -> list[Scenario]:
    """Draw the scenarios of a blind validation.

    Every dozen has the kinds of `DOZEN`; every effect and every grade comes equally often.

    ``only`` makes all sessions of one kind.
    """
    kinds = DOZEN if only is None else (only,)
    rng = np.random.default_rng([seed, 0])
    singles = cycle(rng, [(e, d) for e in LISTED for d in GRADES])
    excluded = cycle(rng, [(e, d) for e in LISTED if e not in TOLD_AS_ANOTHER for d in STRONG_GRADES])
    outside = cycle(rng, [(e, d) for e in OUTSIDE for d in STRONG_GRADES])
    scenarios: list[Scenario] = []
    while len(scenarios) < sessions:
        for kind in rng.permutation(np.array(kinds)).tolist():
            number = len(scenarios)
            if kind == "null":
                scenarios.append(Scenario(number, kind, variety=str(rng.choice(NULLS, p=NULL_WEIGHTS))))
            elif kind == "two":
                pair = _pair(rng)
                scenarios.append(Scenario(number, kind, pair, tuple(float(d) for d in rng.choice(PAIR_GRADES, 2))))
            else:
                effect, d = next({"single": singles, "excluded": excluded, "outside": outside}[kind])
                scenarios.append(Scenario(number, kind, (effect,), (d,)))
    return scenarios[:sessions]


def cycle(rng: np.random.Generator, pairs: list[tuple[str, float]]) -> Any:
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


def generator_of(seed: int, scenario: Scenario) -> np.random.Generator:
    """Return the random numbers of a scenario."""
    return np.random.default_rng([seed, 1, scenario.number])


def make(seed: int, scenario: Scenario, folder: Path) -> dict[str, Any]:
    """Make the session of a scenario, write its file into ``folder``, and return the truth of it."""
    rng = generator_of(seed, scenario)
    concealed = concealed_of(rng, scenario)
    d = surviving(concealed).d if concealed.hidden or scenario.variety in NULLS[2:] else 0.0
    recorded = record(rng, concealed, scenario.number)
    write_session(folder / f"{scenario.name}.h5", recorded.session)
    known = truth(concealed, d, recorded.knowing_rms)
    if scenario.kind == "null":  # what no free decay shows is nothing that a diagnosis could name
        known |= {"kinds": [], "components": [], "strength": [], "d_of_each": []}
    excluded = scenario.effects[0] if scenario.kind == "excluded" else None
    return {
        "kind": scenario.kind,
        "variety": scenario.variety,
        "asked_d": list(scenario.d),
        "without": excluded,
        **known,
    }


def concealed_of(rng: np.random.Generator, scenario: Scenario) -> Concealed:
    """Return what a scenario hides; ``rng`` is that of its seed and number."""
    if scenario.kind == "null":
        exact = scenario.variety == NULLS[0]
        plan = random_plan(rng, exact=exact, size=scenario.size)
        if scenario.variety == NULLS[2]:
            return Concealed(plan, undeclared_hz=float(rng.uniform(*UNDECLARED_HZ)))
        if scenario.variety == NULLS[3]:
            return Concealed(plan, drift_n=float(rng.uniform(-1, 1) * LARGEST_DRIFT_N))
        if scenario.variety in HIDDEN:
            return hiding(rng, plan, HIDDEN[scenario.variety])
        return Concealed(plan)
    # effects that set the strength of the taps come first: the grades of the others depend on it
    effects = sorted((effect_named(e) for e in scenario.effects), key=lambda e: not e.fixed)
    grades = dict(zip(scenario.effects, scenario.d, strict=True))
    exponent = next((e.exponent for e in effects if e.exponent is not None), None)
    parts = any(e.id == "contact_loss" for e in effects)
    plan = random_plan(rng, exponent=exponent, force_ratio=FORCE_RATIO_TO_PART if parts else None, size=scenario.size)
    concealed = Concealed(plan)
    for effect in effects:
        character = effect.draw(rng, concealed.plan)
        concealed = conceal(concealed.plan, effect, character, grades[effect.id], concealed.hidden)
    return graded_anew(concealed) if len(effects) > 1 else concealed


def hiding(rng: np.random.Generator, plan: Plan, effect: Effect) -> Concealed:
    """Return a session with an effect of `HIDDEN`, its strength drawn."""
    strength = math.exp(rng.uniform(math.log(effect.first), math.log(effect.largest)))
    return Concealed(plan, (Hidden(effect, strength, effect.draw(rng, plan)),))


def graded_anew(concealed: Concealed) -> Concealed:
    """Return the session with the ``d`` of each effect alone, in the plan as it has become."""
    plan = concealed.plan
    hidden = tuple(replace(h, d=surviving(Concealed(plan, (h,))).d) for h in concealed.hidden)
    return replace(concealed, hidden=hidden)


def effect_named(name: str) -> Effect:
    """Return an effect of either list."""
    return LISTED[name] if name in LISTED else OUTSIDE[name]


def likeness(seed: int, scenario: Scenario, name: str) -> float:
    """Return the largest cosine between what survives of a session's effects and what would of another one.

    The other effect is tried with several characters, at the same ``d``.
    """
    rng = generator_of(seed, scenario)
    concealed = concealed_of(rng, scenario)
    plan, true = concealed.plan, surviving(concealed)
    other = effect_named(name)
    largest = 0.0
    for _ in range(CHARACTERS):
        rival = conceal(plan, other, other.draw(rng, plan), true.d)
        # an effect that was graded with stronger taps is compared at the strength of the recorded ones
        same = replace(rival, plan=plan)
        largest = max(largest, alike(true, surviving(same)))
    return largest
