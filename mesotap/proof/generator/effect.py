"""What an effect is, and how one is put on the machine: a force law in a link, a body on a spring."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.generator.integration import Acting, Machine, integrate
from mesotap.proof.generator.nature import Nature
from mesotap.proof.generator.plan import Plan, machine_of

Real = NDArray[np.float64]
Character = Mapping[str, Any]
Machined = Callable[[Machine, Plan, float, Character], Machine]
Sensed = Callable[[Real, Plan, float, Character], Real]

LOUDEST_S = 4e-3  # after a tap: by then a channel has shown its largest value
FULL = 1.0  # strength of an effect that is there or not


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect.

    Attributes
    ----------
    id, component
        The contract's names; an effect outside the list has a name of its own.
    listed
        Whether the contract lists it.
    first, largest
        Strength to try first, and the largest that makes sense, in the effect's own unit.
    draw
        Character. An array in it has a number for each impact; all else belongs to the rig.
    machined
        The machine with the effect.
    sensed
        The (n, 2, samples) channels with the effect.
    mounted
        What the channels sense, (n, 2, steps), before any filter.
    delay
        Delay of channel B, samples: one number, or (samples,).
    parameters
        Parameters for the truth file.
    fixed
        An effect without a strength of its own: the taps are graded instead.
    exponent
        Of k_c against the load, where the effect asks for one.
    nature
        Of an effect outside the list: what a learned law is to say of it.
    """

    id: str
    component: str
    first: float
    largest: float
    parameters: Callable[[Plan, float, Character], dict[str, Any]]
    draw: Callable[[np.random.Generator, Plan], Character] = lambda rng, plan: {}
    machined: Machined | None = None
    sensed: Sensed | None = None
    mounted: Sensed | None = None
    delay: Callable[[Plan, float, Character], float | Real] | None = None
    listed: bool = True
    fixed: bool = False
    exponent: float | None = None
    nature: Nature | None = None


def typical_ratio(plan: Plan) -> float:
    """Median over the loads of the largest approach over the static one, as the taps were drawn."""
    return float(np.median(approach(plan) / plan.of_each_impact(plan.static)))


def approach(plan: Plan) -> Real:
    """Return (n,) the largest deformation of the contact after each tap, m: of its own mode under the impulse."""
    angular = np.sqrt((plan.springs[1] + 2 * plan.kc) / plan.masses[1])
    return np.asarray(impulses(plan) / plan.masses[0] / plan.of_each_impact(angular))


def largest_approach(plan: Plan) -> float:
    """Return the largest amplitude of the contact's deformation after a tap, m."""
    return float(approach(plan).max())


def typical_rate(plan: Plan) -> float:
    """Return the median amplitude of the contact's rate after a tap, m/s."""
    angular = np.sqrt((plan.springs[1] + 2 * plan.kc) / plan.masses[1])
    return float(np.median(approach(plan) * plan.of_each_impact(angular)))


def typical_reading(plan: Plan) -> float:
    """Return the median over the taps of the largest acceleration that Eq. 9 shows, m/s2."""
    seen = integrate(machine_of(plan), round(LOUDEST_S / plan.step_s), plan.step_s)
    return float(np.median(np.abs(seen).max(axis=(1, 2))))


def impulses(plan: Plan) -> Real:
    """Return (n,) the momentum that each tap gives, N s."""
    shape = np.sin(np.pi * (np.arange(50) + 0.5)[None, :] / 50) ** plan.pulses[:, 0, 3][:, None]
    return np.asarray(plan.pulses[:, 0, 2] * plan.pulses[:, 0, 1] * shape.mean(axis=1))


def with_law(machine: Machine, law: IntEnum, direction: Real, numbers: Real) -> Machine:
    """Return the machine with one more law; ``numbers`` (n, k) or (k,)."""
    count = machine.stiffness.shape[0]
    acting = Acting(int(law), direction, np.broadcast_to(numbers, (count, np.shape(numbers)[-1])).copy())
    return replace(machine, acting=(*machine.acting, acting))


def in_contact(machine: Machine, plan: Plan, law: IntEnum, *own: Any) -> Machine:
    """Add a law in the contact; each of its ``own`` numbers for all impacts or (n,)."""
    count = plan.group.size
    columns = [plan.of_each_impact(plan.loads), plan.of_each_impact(plan.kc), plan.of_each_impact(plan.cc)]
    columns += [np.broadcast_to(np.asarray(o, float), (count,)) for o in own]
    return with_law(machine, law, machine.contact, np.column_stack(columns))


def in_spring(machine: Machine, plan: Plan, which: int, law: IntEnum, *own: float) -> Machine:
    """Add a law in the upper (0) or lower (1) tube spring."""
    direction = np.zeros(machine.mass.size)
    direction[which] = 1.0
    return with_law(machine, law, direction, np.array([0.0, plan.springs[which], 0.0, *own]))


def with_body(machine: Machine, mass: float, direction: Real, stiffness: float, damping: float) -> Machine:
    """Return the machine with one more body, on a spring and damper along ``direction`` (b + 1,)."""
    b = machine.mass.size
    wider = ((0, 0), (0, 1), (0, 1))
    both = np.outer(direction, direction)
    return replace(
        machine,
        mass=np.append(machine.mass, mass),
        stiffness=np.pad(machine.stiffness, wider) + stiffness * both,
        damping=np.pad(machine.damping, wider) + damping * both,
        contact=np.append(machine.contact, 0.0),
        seen=np.pad(machine.seen, ((0, 0), (0, 1))),
        thrown=None if machine.thrown is None else np.pad(machine.thrown, ((0, 0), (0, 1))),
        acting=tuple(
            replace(a, direction=np.append(a.direction, np.zeros(b + 1 - a.direction.size))) for a in machine.acting
        ),
    )
