"""The extra forces at a step's end: what the laws answer to the motion that these forces themselves make."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from numba import njit

from sim_backend.force_law import DAMPING, SLOTS, STIFFNESS

NOW, LAST, NEW, CURVE, OLD_CURVE, PEAK, LINEAR, IMPULSE, FIRST, SECOND, STEEP = range(11)
ROWS: Final = STEEP + 1
"""Numbers of each element, the rows of the loop's table of forces.

The extra force at the step's beginning, a step before, and at its end; its bend in this step and the one before, and
the largest one so far; the linear force; the mean over an undivided step; what the first two evaluations were asked;
whether the law answers to a little with much.
"""
GAIN: Final = 2.0  # change of a law's answer over that of the force: beyond 2.5 a parabola overshoots ever further
SETTLED: Final = 1e-6  # of the largest force: what a law's answer may differ from the force that it answers to
MOST_TRIES: Final = 40  # to find the force that a law answers with itself

uncounted: Any = partial(njit, cache=True, nogil=True, error_model="numpy", _nrt=False)
"""Compiles what makes no arrays, without the counting of references to them: eight times as fast."""


@njit(inline="always")
def evaluate(run, level, shape, t, turn):  # type: ignore[no-untyped-def]
    """Put the extra forces for the motion at the step's end into ``NEW``, as it is with those that are there."""
    _, parabola, constant, _ = shape
    law, element, own, found, force, late = run.law, run.element, run.own, run.found, run.force, run.late
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
                new = force[NEW, e]
                d += (late[level, 0, x, e] + parabola * late[level, 1, x, e] + constant * late[level, 2, x, e]) * new
                v += (late[level, 0, y, e] + parabola * late[level, 1, y, e] + constant * late[level, 2, y, e]) * new
            linear = own[k, STIFFNESS] * d + own[k, DAMPING] * v
            total = linear
        total = law[k](total, d, v, t, own[k], run.memory[turn, k], run.memory[1 - turn, k])
        force[NEW, i], force[LINEAR, i] = total - linear, linear


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
        evaluate(run, level, shape, t, turn)
        steep = answer - force[NEW, e] > GAIN * more
        force[NEW, e] = b
        if not steep:
            evaluate(run, level, shape, t, turn)
    force[STEEP, e] = 1.0 if steep else 0.0
    if not apart:
        return
    for _ in range(MOST_TRIES):
        x = b - over_b * (b - a) / (over_b - over_a)
        force[NEW, e] = x
        evaluate(run, level, shape, t, turn)
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
def is_held(force):  # type: ignore[no-untyped-def]
    """Whether a force holds a body where it is."""
    held = False
    for e in range(force.shape[1]):
        held = held or force[STEEP, e] > 0.0
    return held
