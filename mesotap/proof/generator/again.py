"""Another session of a concealed machine: the same rig and effects at other loads, with other taps and noise.

A law that was learned from one session is tried on the other. Constants of effects outside the list belong to the rig;
of the listed ones `quadratic_damping` and `clipping` take their size from the taps of each session.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.session_file import write_session
from mesotap.proof.generator.concealed import Concealed, Hidden, record, signals, surviving, truth
from mesotap.proof.generator.effect import Character, Effect, impulses
from mesotap.proof.generator.plan import STEPS_PER_SAMPLE, Plan
from mesotap.proof.generator.scenarios import Scenario, concealed_of, generator_of

Real = NDArray[np.float64]

SCATTER_OF_KC = 0.004  # of the contact's stiffness about its power of the load, relative
SCATTER_OF_TAPS = 0.35  # of the logarithm of their force
SOFTER = 0.7  # of the taps, where a law that softens does not hold the machine together
APART = 0.92  # of two loads, at the most


def again(rng: np.random.Generator, concealed: Concealed, size: tuple[int, int] | None = None) -> Concealed:
    """Return another session of the machine.

    Parameters
    ----------
    rng
        Draws loads (within those of the first session), taps, and what a character has for each impact.
    concealed
        The first session.
    size
        How many loads and how many taps at each; those of the first session without.
    """
    plan = concealed.plan
    count, taps = size or (plan.loads.size, int(np.sum(plan.group == 0)))
    loads = _loads(rng, plan, count)
    kc = np.exp(np.mean(np.log(plan.kc / plan.loads**plan.exponent))) * loads**plan.exponent
    kc *= 1 + SCATTER_OF_KC * rng.standard_normal(count)
    group = np.repeat(np.arange(count), taps)
    pulses = plan.pulses[rng.integers(0, plan.group.size, group.size)].copy()
    pulses[:, 0, 2] *= _factors(rng, plan, pulses, loads[group])
    other = replace(
        plan,
        loads=loads,
        kc=kc,
        cc=_damping(plan, loads, kc),
        group=group,
        pulses=pulses,
        offset=rng.integers(0, STEPS_PER_SAMPLE, group.size),
    )
    hidden = tuple(replace(h, character=_of_the_rig(rng, h.effect, h.character, other)) for h in concealed.hidden)
    session = replace(concealed, plan=other, hidden=hidden)
    while session.hidden and not np.all(np.isfinite(signals(session))):
        pulses *= SOFTER
        session = replace(session, plan=replace(other, pulses=pulses))
    return replace(session, hidden=tuple(_graded(session.plan, h) for h in hidden))


def make_again(
    seed: int, scenario: Scenario, folder: Path, which: int = 1, size: tuple[int, int] | None = None
) -> dict[str, Any]:
    """Make another session of a scenario's machine, write ``NAME-again-WHICH.h5``, and return the truth of it."""
    first = concealed_of(generator_of(seed, scenario), scenario)
    rng = np.random.default_rng([seed, 7, scenario.number, which])
    session = again(rng, first, size)
    recorded = record(rng, session, scenario.number)
    write_session(folder / f"{scenario.name}-again-{which}.h5", recorded.session)
    d = surviving(session).d if session.hidden else 0.0
    return {
        "kind": scenario.kind,
        "variety": scenario.variety,
        "without": None,
        **truth(session, d, recorded.knowing_rms),
    }


def _loads(rng: np.random.Generator, plan: Plan, count: int) -> Real:
    """Draw loads within those of the plan, 8 % apart at the least, N."""
    low, high = np.log(plan.loads[0]), np.log(plan.loads[-1])
    room = high - low + (count - 1) * np.log(APART)
    if room <= 0:
        raise ValueError(f"{count} loads do not find room between {plan.loads[0]:g} and {plan.loads[-1]:g} N")
    return np.asarray(np.exp(low + np.sort(rng.uniform(0, room, count)) - np.arange(count) * np.log(APART)))


def _power(loads: Real, values: Real, others: Real) -> Real:
    """Return what a power of the load, fitted to ``values`` at ``loads``, has at ``others``."""
    degree = 1 if np.unique(loads).size > 1 else 0
    return np.asarray(np.exp(np.polyval(np.polyfit(np.log(loads), np.log(values), degree), np.log(others))))


def _damping(plan: Plan, loads: Real, kc: Real) -> Real:
    """Return the damping, N s/m, whose ratio is a power of the load, as the plan's is but for its scatter."""
    zeta = plan.cc / plan.masses[1] / np.sqrt((plan.springs[1] + 2 * plan.kc) / plan.masses[1])
    angular = np.sqrt((plan.springs[1] + 2 * kc) / plan.masses[1])
    return np.asarray(_power(plan.loads, zeta, loads) * plan.masses[1] * angular)


def _factors(rng: np.random.Generator, plan: Plan, pulses: Real, loads: Real) -> Real:
    """Return factors (n,) that give ``pulses`` the momentum of the plan's taps at these ``loads``, scattered."""
    typical = _power(plan.of_each_impact(plan.loads), impulses(plan), loads)
    return np.asarray(
        typical / impulses(replace(plan, pulses=pulses)) * np.exp(SCATTER_OF_TAPS * rng.standard_normal(loads.size))
    )


def _of_the_rig(rng: np.random.Generator, effect: Effect, character: Character, plan: Plan) -> Character:
    """What a character has for each impact is drawn anew, all else stays."""
    drawn = effect.draw(rng, plan)
    return {k: drawn[k] if isinstance(v, np.ndarray) else v for k, v in character.items()}


def _graded(plan: Plan, hidden: Hidden) -> Hidden:
    return replace(hidden, d=surviving(Concealed(plan, (hidden,))).d)
