"""The extra forces at a step's end: what the laws answer to the motion that these forces themselves make."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from numba import njit

from sim_backend.force_law import DAMPING, SLOTS, STIFFNESS

NOW, LAST, NEW, CURVE, OLD_CURVE, PEAK, LINEAR, IMPULSE, FIRST, SECOND, STEEP, RATE, TURNS, AFTER, LEAN, HELD = range(
    16
)
ROWS: Final = HELD + 1
"""Numbers of each element, the rows of the loop's table of forces.

The extra force at the step's beginning, a step before, and at its end; its bend in this step and the one before, and
the largest one so far; the linear force; the mean over an undivided step; what the first two evaluations were asked;
whether the law answers to a little with much. The rate of the deformation at the step's beginning; whether it turns
about in this step, so that the force at its end is the mean over all of it, and what the law then answers at the end.
How far a mean force goes from one end of the step to the other, over how far it is from the one before, and whether
that one held a body.
"""
HOLDS, TURNED, STOPPED = 1.0, 1.0, 2.0
"""What `STEEP` is where a force holds a body, and `TURNS` where an element turns about or stops."""
GAIN: Final = 2.0  # change of a law's answer over that of the force: beyond 2.5 a parabola overshoots ever further
SETTLED: Final = 1e-6  # of the largest force: what a law's answer may differ from the force that it answers to
MOST_TRIES: Final = 40  # to find the force that a law answers with itself
NEARER: Final = 0.125  # of the rates before and after a turn, at which a force that jumps between them is the same
SAME: Final = 0.01  # of the jump, that such forces may differ by
JUMP: Final = 0.1  # of the largest force, that is a jump

uncounted: Any = partial(njit, cache=True, nogil=True, error_model="numpy", _nrt=False)
"""Compiles what makes no arrays, without the counting of references to them: eight times as fast."""


@njit(inline="always")
def weight(run, level, row, e, shape, jumping):  # type: ignore[no-untyped-def]
    """Return what a unit of an element's force ``NEW`` makes of a row of what is found at the step's end."""
    _, parabola, constant, _ = shape
    late, lean = run.late, run.force[LEAN, e]
    if not jumping:
        return late[level, 0, row, e] + parabola * late[level, 1, row, e]
    if run.force[TURNS, e] > 0.0:
        return late[level, 0, row, e] + late[level, 2, row, e]
    begun = (constant - lean) * late[level, 2, row, e]
    return (1.0 + lean) * late[level, 0, row, e] + parabola * late[level, 1, row, e] + begun


@njit(inline="always")
def evaluate(run, level, shape, t, turn, jumping):  # type: ignore[no-untyped-def]
    """Put the extra forces for the motion at the step's end into ``NEW``, as it is with those that are there."""
    law, element, own, found, force = run.law, run.element, run.own, run.found, run.force
    elements = force.shape[1]
    size = len(found) - 2 * elements
    d, v, linear, total = 0.0, 0.0, 0.0, 0.0
    for k in range(SLOTS):
        i = element[k]
        if i < 0:
            break
        if k == 0 or element[k - 1] != i:
            x, y = size + i, size + elements + i
            d, v = found[x], found[y]
            for e in range(elements):
                d += weight(run, level, x, e, shape, jumping) * force[NEW, e]
                v += weight(run, level, y, e, shape, jumping) * force[NEW, e]
            linear = own[k, STIFFNESS] * d + own[k, DAMPING] * v
            total = linear
        total = law[k](total, d, v, t, own[k], run.memory[turn, k], run.memory[1 - turn, k])
        force[LINEAR, i] = linear
        force[AFTER if jumping and force[TURNS, i] > 0.0 else NEW, i] = total - linear


@uncounted()
def _answer(run, e, d, v, t, turn):  # type: ignore[no-untyped-def]
    """Return the extra force that the laws of an element answer to a deformation and its rate."""
    linear, total, first = 0.0, 0.0, True
    for k in range(SLOTS):
        if run.element[k] == e:
            if first:
                linear = run.own[k, STIFFNESS] * d + run.own[k, DAMPING] * v
                total, first = linear, False
            total = run.law[k](total, d, v, t, run.own[k], run.memory[turn, k], run.memory[1 - turn, k])
    return total - linear


@uncounted()
def turn_about(run, e, level, shape, t, turn):  # type: ignore[no-untyped-def]
    """Let an element turn about or stop within the step where it does, if its force then jumps.

    When that is, the rate tells that the element would end with under the force before. Where it turns about, the mean
    of the forces before and after does what both do; where it gets no further than to rest, the force that stops it.
    """
    force, found, begin, matrix, late = run.force, run.found, run.known, run.matrix, run.late
    elements = force.shape[1]
    size = len(found) - 2 * elements
    x, y, now, before = size + e, size + elements + e, force[NOW, e], force[RATE, e]
    if force[LEAN, e] > 0.0:  # it was held
        return
    d, rate = found[x], found[y]
    for other in range(elements):
        if other != e:
            d += weight(run, level, x, other, shape, True) * force[NEW, other]
            rate += weight(run, level, y, other, shape, True) * force[NEW, other]
    own, bend = begin[size + e], begin[size + elements + e]
    rate -= matrix[level, y, size + e] * own + matrix[level, y, size + elements + e] * bend
    d -= matrix[level, x, size + e] * own + matrix[level, x, size + elements + e] * bend
    at_once = late[level, 0, y, e] + late[level, 2, y, e]  # rate at the end by a unit of a constant force
    goes_on = rate + at_once * now
    if before * goes_on >= 0.0:
        return
    share = before / (before - goes_on)
    after = _answer(run, e, d, goes_on, t, turn)
    jump = abs(after - now)
    if jump < JUMP * max(force[PEAK, e], abs(after)):
        return
    nearer = _answer(run, e, d, NEARER * before, t, turn), _answer(run, e, d, NEARER * goes_on, t, turn)
    if abs(nearer[0] - now) > SAME * jump or abs(nearer[1] - after) > SAME * jump:
        return
    mean, stops = share * now + (1.0 - share) * after, False
    if before * (rate + at_once * mean) >= 0.0:
        mean, stops = -rate / at_once, True
    for i in range(len(found)):
        found[i] -= matrix[level, i, size + e] * own + matrix[level, i, size + elements + e] * bend
    begin[size + e], begin[size + elements + e] = 0.0, 0.0
    force[TURNS, e], force[NEW, e] = STOPPED if stops else TURNED, mean


@uncounted()
def settle(run, e, level, shape, t, turn):  # type: ignore[no-untyped-def]
    """Find the force in an element that its law answers with itself, where two evaluations did not come nearer to it.

    So dry friction holds a body that sticks: a slight speed would turn its whole force about. By the secants of what
    the law answers beyond what it was asked, between forces at which that has either sign.
    """
    force = run.force
    a, b = force[FIRST, e], force[SECOND, e]
    over_a, over_b = b - a, force[NEW, e] - b
    largest = max(force[PEAK, e], abs(force[NEW, e]))
    found = abs(over_b) <= SETTLED * largest
    apart = not found and over_a * over_b < 0.0 and abs(over_b) >= 0.5 * abs(over_a)
    steep = apart and over_b - over_a > GAIN * (a - b) if a > b else apart and over_a - over_b > GAIN * (b - a)
    if found and force[STEEP, e] > 0.0 and largest > 0.0:  # does it still answer to little with much?
        answer, more = force[NEW, e], SETTLED * largest
        force[NEW, e] = b + more
        evaluate(run, level, shape, t, turn, True)
        steep = answer - force[NEW, e] > GAIN * more
        force[NEW, e] = b
        if not steep:
            evaluate(run, level, shape, t, turn, True)
    force[STEEP, e] = 1.0 if steep else 0.0
    if not apart:
        return
    for _ in range(MOST_TRIES):
        x = b - over_b * (b - a) / (over_b - over_a)
        force[NEW, e] = x
        evaluate(run, level, shape, t, turn, True)
        over = force[NEW, e] - x
        if over * over_b < 0.0:
            a, over_a = b, over_b
        else:
            over_a *= 0.5
        b, over_b = x, over
        if abs(over) <= SETTLED * largest or abs(b - a) <= SETTLED * SETTLED * largest:
            break
    force[NEW, e] = b


@njit(inline="always")
def anywhere(force, row, least):  # type: ignore[no-untyped-def]
    """Whether any element holds (``STEEP``), turns about or stops (``TURNS``): whether its number is so large."""
    found = False
    for e in range(force.shape[1]):
        found = found or force[row, e] >= least
    return found
