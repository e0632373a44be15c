"""The compiled loop: steps of a linear rig, divided where an extra force bends abruptly."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit, types

from sim_backend.arrays import Real, Whole
from sim_backend.force_law import LAW, MEMORY, SLOTS, STEP
from sim_backend.propagate.exact_step import exact_steps
from sim_backend.propagate.forces import (
    AFTER,
    CURVE,
    FIRST,
    HELD,
    HOLDS,
    IMPULSE,
    LAST,
    LEAN,
    LINEAR,
    NEW,
    NOW,
    OLD_CURVE,
    PEAK,
    RATE,
    ROWS,
    SECOND,
    STEEP,
    STOPPED,
    TURNED,
    TURNS,
    anywhere,
    evaluate,
    settle,
    turn_about,
    uncounted,
    weight,
)  # fmt: skip
from sim_backend.propagate.inputs import Clock, Given, Impact, Laws, Rigs

Forces = tuple[Any, ...]

DEEPEST: Final = 3  # times that a step may be divided by four
TICKS: Final = 4**DEEPEST  # shortest steps in one
TICK: Final = 1 / TICKS
COARSER: Final = 4.0**3  # factor by which the error grows in a step four times as long
MOST_DIVIDED: Final = 12  # short steps for a whole one, on average: beyond, the motion runs away
RUNAWAY: Final = 1e300  # of the first state: what follows is not computed
FAINT: Final = 1e-9  # share of an element's linear force below which an extra force is rounding
SHAPES: Final = 4  # a step's division is written as its level, and so often how many values of the force were known
HOLDING: Final = 3e-5  # error that a step counts as, over the change of a force that holds a body where it is
TURNING: Final = 2  # times divided by four, that a step is in which an element turns about
LOOSER: Final = 2.0  # factor in the tolerance beyond which a motion that follows another's division divides by itself

_ROW = types.Array(types.float64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")
_STACK = types.Array(types.float64, 3, "C")

_WHOLE = types.Array(types.int64, 1, "C")
_DIVISION = types.Array(types.int8, 2, "C")
_LAWS = types.UniTuple(types.FunctionType(LAW), SLOTS)
_SIGNATURE = types.UniTuple(_STACK, 3)(
    types.NamedTuple((_TABLE, _STACK, _STACK, _STACK, _STACK), Rigs),
    types.NamedTuple((_LAWS, _WHOLE, _STACK, _WHOLE), Laws),
    _TABLE,
    types.NamedTuple((_ROW, types.float64, types.int64, types.int64), Clock),
    types.NamedTuple((_STACK, _STACK, _STACK, types.int64), Given),
    types.NamedTuple((_WHOLE, _TABLE), Impact),
    types.float64,
    _DIVISION,
    types.boolean,
)


class _Run(NamedTuple):
    """One motion: its exact steps at every division, its laws and inputs, and where it is now.

    Displacements are in units that make them as large as velocities. What is known at a step's beginning is the state,
    then start and bend of the elements' forces, then start, end and bend of the inputs; what is found at its end is the
    state, then deformations and rates of the elements.

    Attributes
    ----------
    matrix
        (divisions, found, known) from what is known to what is found, but for the elements' forces at the end.
    late
        (divisions, 3, found, elements) what these, their bends, and those at the beginning add.
    law, element, own, jumps
        Force laws, the element of each, their parameters (SLOTS, any), and whether they jump (SLOTS,).
    start, end, bend, held
        (u, k) inputs, see `Given`.
    begun, h
        Time of the first state and length of an undivided step, s.
    known, found
        What is known and found of the present step.
    force, memory
        (ROWS, elements) numbers of each element, and (2, SLOTS, MEMORY) the laws' memories, in turn before and after.
    spans
        (3,) lengths of the present step and of the two before, in undivided steps.
    """

    matrix: Real
    late: Real
    law: Forces
    element: Whole
    own: Real
    jumps: Whole
    start: Real
    end: Real
    bend: Real
    held: int
    begun: float
    h: float
    known: Real
    found: Real
    force: Real
    memory: Real
    spans: Real


@njit(inline="always")
def _parabola(known, spans):  # type: ignore[no-untyped-def]
    """Return how a force goes along a step.

    Over its length the step before, the share of the value at the end in the bend, and in the value at the beginning (1
    where it holds a body), and the weight of errors.
    """
    if known < 2:
        return 1.0, 0.0, 1.0 - known, 0.0
    if spans[0] == spans[1] == spans[2]:
        return 1.0, 0.5, 0.0, 1 / 12
    ratio = spans[1] / spans[0]
    return ratio, 1.0 / (1.0 + ratio), 0.0, (1 / 12 + ratio / 6) / (1.0 + ratio + spans[2] / spans[0])


@njit(inline="always")
def _attempt(run, level, known, shape, t, turn, jumping):  # type: ignore[no-untyped-def]
    """Step to time t; return the error of the mean extra force over its largest so far.

    ``known`` is how many values of the extra force count (3: enough for an error; 0: it is constant and holds a body),
    ``shape`` that of its parabola.
    """
    begin, found, force, matrix = run.known, run.found, run.force, run.matrix
    elements, square = force.shape[1], run.spans[0] ** 2
    size = len(found) - 2 * elements
    ratio, parabola, constant, weight = shape
    for e in range(elements):
        now = force[NOW, e]
        slope = (now - force[LAST, e]) / ratio if known > 1 else 0.0
        curve = force[OLD_CURVE, e] * square if known > 2 else 0.0
        begin[size + e], begin[size + elements + e] = (1.0 - constant) * now, -parabola * (now + slope)
        force[NEW, e] = now + slope + (1.0 + ratio) * curve
        if jumping:
            force[TURNS, e] = 0.0
            force[LEAN, e] = force[HELD, e] / (1.0 + run.spans[1] / run.spans[0]) if constant > 0.0 else 0.0
    for i in range(len(found)):
        total = 0.0
        for j in range(len(begin)):
            total += matrix[level, i, j] * begin[j]
        if jumping and constant > 0.0:
            for e in range(elements):
                total -= force[LEAN, e] * force[NOW, e] * (run.late[level, 0, i, e] - run.late[level, 2, i, e])
        found[i] = total
    for k in range(SLOTS):
        if jumping and run.jumps[k] > 0:
            turn_about(run, run.element[k], level, shape, t, turn)
    for e in range(elements):
        force[FIRST, e] = force[NEW, e]
    evaluate(run, level, shape, t, turn, jumping)
    for e in range(elements):
        force[SECOND, e] = force[NEW, e]
    evaluate(run, level, shape, t, turn, jumping)
    for k in range(SLOTS):
        if jumping and run.jumps[k] > 0 and not force[TURNS, run.element[k]] > 0.0:
            settle(run, run.element[k], level, shape, t, turn)
    worst = 0.0
    for e in range(elements):
        bend = parabola * force[NEW, e] + begin[size + elements + e]
        force[CURVE, e] = bend
        largest = max(force[PEAK, e], FAINT * abs(force[LINEAR, e]))
        off = weight * abs(bend - force[OLD_CURVE, e] * square) if known > 2 else 0.0
        if jumping and force[TURNS, e] > 0.0:
            force[CURVE, e], force[STEEP, e], off = 0.0, 0.0, 0.0 if level >= TURNING else largest
        if jumping and force[STEEP, e] > 0.0:  # a parabola would overshoot from step to step
            off = HOLDING * abs(force[NEW, e] - force[NOW, e])
        if off > worst * largest:
            worst = off / largest
    return worst


@njit(inline="always")
def _inputs(run, k, low, high):  # type: ignore[no-untyped-def]
    """Put start, end and bend of the k-th inputs between two fractions of a step into ``known``."""
    start, end, bend, known = run.start, run.end, run.bend, run.known
    first = len(known) - 3 * len(start)
    for u in range(len(start)):
        a, b, c = start[u, k], end[u, k], bend[u, k]
        known[first + 3 * u] = a + (b - a) * low + c * low * (low - 1.0)
        known[first + 3 * u + 1] = a + (b - a) * high + c * high * (high - 1.0)
        known[first + 3 * u + 2] = c * (high - low) ** 2


@njit(inline="always")
def _accept(run, level, shape, jumping):  # type: ignore[no-untyped-def]
    """Make the attempted step's end the present."""
    _, _, constant, _ = shape
    known, found, force, spans = run.known, run.found, run.force, run.spans
    elements, span = force.shape[1], spans[0]
    size = len(found) - 2 * elements
    for i in range(len(found)):
        total = found[i]
        for e in range(elements):
            total += weight(run, level, i, e, shape, jumping) * force[NEW, e]
        found[i] = total
    for i in range(size):
        known[i] = found[i]
    for e in range(elements):
        now, new = force[NOW, e], force[NEW, e]
        begun = now
        if jumping:
            begun = new if force[TURNS, e] > 0.0 else constant * new + (1.0 - constant) * now
        force[IMPULSE, e] += span * (0.5 * (begun + new) - force[CURVE, e] / 6.0)
        force[OLD_CURVE, e] = force[CURVE, e] / (span * span)
        rate = found[size + elements + e]
        held = jumping and (force[STEEP, e] > 0.0 or force[TURNS, e] == STOPPED)
        if held and not force[HELD, e] > 0.0:  # it stopped: from now on the force is the one that changes no rate
            row = size + elements + e
            new -= (rate - force[RATE, e]) / (run.late[level, 0, row, e] + run.late[level, 2, row, e])
        elif jumping and force[TURNS, e] > 0.0:
            new = force[AFTER, e]
        force[LAST, e], force[NOW, e], force[RATE, e], force[HELD, e] = now, new, rate, 1.0 if held else 0.0
        force[PEAK, e] = max(force[PEAK, e], abs(new))
    spans[2], spans[1] = spans[1], span


@uncounted()
def _start(run, sees, t, turn):  # type: ignore[no-untyped-def]
    """Evaluate the laws at the present state, as at a start; the memories begin anew with turn 0."""
    force, known, found = run.force, run.known, run.found
    elements = force.shape[1]
    size = len(found) - 2 * elements
    for k in range(SLOTS):
        for m in range(MEMORY):
            run.memory[0, k, m] = run.memory[turn, k, m]
    for i in range(size, len(found)):
        found[i] = 0.0
        for j in range(size):
            found[i] += sees[i, j] * known[j]
    for e in range(elements):
        force[NEW, e], force[TURNS, e], force[RATE, e] = 0.0, 0.0, found[size + elements + e]
        force[LEAN, e] = force[HELD, e] = 0.0
    evaluate(run, 0, (1.0, 0.0, 0.0, 0.0), t, 0, True)
    for e in range(elements):
        force[NOW, e] = force[NEW, e]
        force[PEAK, e] = max(force[PEAK, e], abs(force[NEW, e]))
    for k in range(SLOTS):
        for m in range(MEMORY):
            run.memory[0, k, m] = run.memory[1, k, m]


@uncounted()
def _set_step(own, h):  # type: ignore[no-untyped-def]
    for k in range(SLOTS):
        own[k, STEP] = h


@njit(inline="always")
def _whole_step(run, at, state, tolerance, division, follows, jumping):  # type: ignore[no-untyped-def]
    """Go on by one step, divided as needed or as another motion was.

    Returns
    -------
    tuple
        The new ``state``: division, values known, steps left, turn, number of short steps.
    """
    level, known, left, turn, short = state
    tick, over, force, most = 0, 0, run.force, LOOSER * tolerance if follows else tolerance
    given = at // run.held
    for e in range(force.shape[1]):
        force[IMPULSE, e] = 0.0
    while tick < TICKS:
        if follows and tick == over:
            other = division[short] % SHAPES
            over = tick + (TICKS >> (2 * other))
            known = min(known, division[short] // SHAPES)
            if other != level:
                level = other
                _set_step(run.own, run.h / 4.0**level)
        width = TICKS >> (2 * level)
        run.spans[0] = width * TICK
        shape = _parabola(known, run.spans)
        if len(run.start) > 0:
            _inputs(run, given, tick * TICK, (tick + width) * TICK)
        error = _attempt(run, level, known, shape, run.begun + (at + (tick + width) * TICK) * run.h, turn, jumping)
        left -= 1
        if jumping and known > 0 and anywhere(force, STEEP, HOLDS) and (error > most or not follows):
            known = 0
            continue
        if error > most and level < DEEPEST and left > 0:
            level += 1
            _set_step(run.own, run.h / 4.0**level)
            continue
        _accept(run, level, shape, jumping)
        turn = 1 - turn
        tick += width
        if not follows and len(division) > 0:
            division[short] = level + SHAPES * known
        short += 1 if not follows or tick == over else 0
        holds = jumping and ((known < 1 and anywhere(force, STEEP, HOLDS)) or anywhere(force, TURNS, STOPPED))
        anew = (error > tolerance and left > 0 and not follows) or (jumping and anywhere(force, TURNS, TURNED))
        known = 0 if holds else 1 if anew else min(known + 1, 3)
        calm = ((known == 3 or holds) and COARSER * error < tolerance) or left <= 0
        if not follows and level > 0 and calm and tick % (4 * width) == 0:
            level -= 1
            _set_step(run.own, run.h / 4.0**level)
    return level, known, left, turn, short


@njit(inline="always")
def _carry(run, sees, hit, divided, out, jumping):  # type: ignore[no-untyped-def]
    """Carry one motion along and write its forces, bends and states into ``out``.

    Whether forces may jump is given as a constant, here and in all that it calls: what looks for jumps is left out of
    what is compiled without.
    """
    forces, bends, states, sampled = out
    division, follows, tolerance = divided
    jump, hit_at = hit
    finest = DEEPEST if tolerance < np.inf else 0
    _set_step(run.own, run.h / 4.0**finest)
    _start(run, sees, run.begun, 0)
    for e in range(len(forces)):
        forces[e, 0] = run.force[NOW, e]
    if sampled > 0:
        for j in range(len(jump)):
            states[0, j] = run.known[j]
    steps = bends.shape[1]
    now = (finest, 1, MOST_DIVIDED * steps + TICKS, 0, 0)
    for at in range(1, steps + 1):
        now = _whole_step(run, at - 1, now, tolerance, division, follows, jumping)
        if at == hit_at:
            for j in range(len(jump)):
                run.known[j] += jump[j]
            _set_step(run.own, run.h / 4.0**finest)
            _start(run, sees, run.begun + at * run.h, now[3])
            now = (finest, 1, now[2], 0, now[4])
        for e in range(len(forces)):
            new = run.force[NOW, e]
            bends[e, at - 1] = 6.0 * (0.5 * (forces[e, at - 1] + new) - run.force[IMPULSE, e])
            forces[e, at] = new
        if sampled > 0 and at % sampled == 0:
            for j in range(len(jump)):
                states[at // sampled, j] = run.known[j]
        if not abs(run.known[0]) < RUNAWAY:
            forces[:, at:], bends[:, at - 1 :] = np.nan, np.nan
            if sampled > 0:
                states[(at - 1) // sampled + 1 :] = np.nan
            break


@uncounted()
def _carry_smoothly(run, sees, hit, divided, out):  # type: ignore[no-untyped-def]
    """Carry a motion along in which no force jumps: compiled without all that looks for it."""
    _carry(run, sees, hit, divided, out, False)


@uncounted()
def _carry_jumping(run, sees, hit, divided, out):  # type: ignore[no-untyped-def]
    """Carry a motion along in which forces may jump."""
    _carry(run, sees, hit, divided, out, True)


@njit([_SIGNATURE], cache=True, nogil=True)
def carried(rigs, laws, start, clock, given, impact, tolerance, division, follows):  # type: ignore[no-untyped-def]
    """Return forces, bends and states of `Motion`; ``division`` (runs, any) is filled in, or followed (one by all)."""
    runs, n = rigs.mass.shape
    elements, inputs, h = rigs.rows.shape[1], rigs.inputs.shape[2], clock.step
    forces, bends = np.zeros((runs, elements, clock.steps + 1)), np.zeros((runs, elements, clock.steps))
    samples = clock.steps // clock.sampled + 1 if clock.sampled > 0 else 0
    states, jumping = np.zeros((runs, samples, 2 * n)), np.any(laws.jumps > 0)
    for i in range(runs):
        unit = 0.0
        for j in range(n):
            unit += abs(rigs.stiffness[i, j, j] / rigs.mass[i, j]) / n
        unit = np.sqrt(unit) if unit > 0.0 else 0.1 / abs(h)
        scale = np.ones(2 * n)
        scale[:n] = unit
        matrix, late, sees = exact_steps(rigs, i, unit, h, DEEPEST + 1)
        known = np.zeros(2 * n + 2 * elements + 3 * inputs)
        known[: 2 * n] = start[i] * scale
        g = i if len(given.start) > 1 else 0
        run = _Run(
            matrix, late, laws.law, laws.element, laws.parameters[i].copy(), laws.jumps, given.start[g], given.end[g],
            given.bend[g], given.held, clock.start[i], h, known, np.zeros(len(sees)), np.zeros((ROWS, elements)),
            np.zeros((2, SLOTS, MEMORY)), np.ones(3),
        )  # fmt: skip
        hit, out = (impact.jump[i] * scale, impact.step[i]), (forces[i], bends[i], states[i], clock.sampled)
        divided = division[i if len(division) > 1 else 0], follows, tolerance
        if jumping:
            _carry_jumping(run, sees, hit, divided, out)
        else:
            _carry_smoothly(run, sees, hit, divided, out)
        for k in range(samples):
            states[i, k] /= scale
    return forces, bends, states


carried_at_once: Any = carried.get_overload(_SIGNATURE)
"""`carried` without the look at the types of its arguments, which takes as long as a thousand steps.

They must be as `_SIGNATURE` says, C-contiguous: arrays of another layout are read wrongly and in silence.
"""
