"""The integrator as it is called: arrays made ready for the compiled loop, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_backend.arrays import Real
from sim_backend.propagate.inputs import Clock, Given, Impact, Laws, Rigs
from sim_backend.propagate.stepping import MOST_DIVIDED, TICKS, carried_at_once

Division = NDArray[np.int8]

TOLERANCE: Final = 3e-4  # error of a step's mean extra force, over the largest so far, beyond which it is divided


@dataclass(frozen=True, slots=True)
class Motion:
    """What `propagate` returns.

    Attributes
    ----------
    forces
        (runs, elements, steps + 1) extra force of each element, N, beside its spring's and damper's.
    bends
        (runs, elements, steps) such that ``f0 + (f1 - f0) u + bend u (u - 1)`` has the impulse of the extra force over
        each step.
    states
        (runs, samples, 2 n) displacements (m) and velocities (m/s).
    division
        (runs, any) how each short step was divided, where that was asked for.
    """

    forces: Real
    bends: Real
    states: Real
    division: Division = field(default_factory=lambda: np.zeros((1, 0), np.int8))


def propagate(
    rigs: Rigs,
    laws: Laws,
    start: Real,
    clock: Clock,
    given: Given | None = None,
    impact: Impact | None = None,
    tolerance: float = TOLERANCE,
    division: Division | None = None,
    keeps_division: bool = False,
) -> Motion:
    """Carry rigs along from their states ``start`` (runs, 2 n), displacements (m) and velocities (m/s).

    Parameters
    ----------
    tolerance
        Error of a step's mean extra force, over the largest so far, beyond which the step is divided; infinite for
        steps of one length.
    division
        (runs or 1, any) to divide the steps as those of motions nearby were (`Motion.division`), or all as those of
        one: differences between these and such a motion do not hold the errors that another division makes, which are
        many times as large.
    keeps_division
        Whether it is returned.

    Raises
    ------
    ValueError
        The division is not one of as many motions of as many steps.
    """
    runs, n = rigs.mass.shape
    if given is None:
        none = np.zeros((1, 0, 1))
        given = Given(none, none, none, 1)
    if impact is None:
        impact = Impact(np.full(runs, -1, np.int64), np.zeros((runs, 2 * n)))
    rigs = Rigs(*(np.ascontiguousarray(a, np.float64) for a in rigs))
    begin, end, bend = (np.ascontiguousarray(a, np.float64) for a in given[:3])
    given = Given(begin, end, bend, int(given.held))
    impact = Impact(np.ascontiguousarray(impact.step, np.int64), np.ascontiguousarray(impact.jump, np.float64))
    laws = Laws(
        laws.law,
        np.ascontiguousarray(laws.element, np.int64),
        np.ascontiguousarray(laws.parameters, np.float64),
        np.ascontiguousarray(laws.jumps, np.int64),
    )
    clock = Clock(np.ascontiguousarray(clock.start, np.float64), float(clock.step), int(clock.steps), clock.sampled)
    follows, start = division is not None, np.ascontiguousarray(start, np.float64)
    most = (MOST_DIVIDED + 1) * clock.steps + 2 * TICKS  # short steps: beyond `MOST_DIVIDED`, they are whole ones again
    if division is None:
        division = np.zeros((runs, most if keeps_division else 0), np.int8)
    elif division.shape not in ((runs, most), (1, most)):
        raise ValueError(f"the division {division.shape} is not one of {runs} motions of {clock.steps} steps")
    division = np.ascontiguousarray(division, np.int8)
    forces, bends, states = carried_at_once(
        rigs, laws, start, clock, given, impact, float(tolerance), division, follows
    )
    return Motion(forces, bends, states, division)
