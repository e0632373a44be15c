"""A rig carried along from sample to sample under measured inputs, with extra forces in its elements: compiled.

Between substeps inputs and extra forces are taken as straight lines, for which the linear rig's step is exact whatever
its poles: ``z_(n+1) = E z_n + G0 w_n + G1 w_(n+1)`` with the state ``z = (x, v)`` and ``w`` the inputs and the extra
forces. What is left out is of the order of the step squared times the extra force alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import float64, int64, njit, types
from numpy.typing import NDArray
from scipy.linalg import expm

from sim_backend.modal_march import DAMPING, LAW, MEMORY, SLOTS, STIFFNESS

Real = NDArray[np.float64]
CORRECTIONS = 2  # passes over each step: the law's force depends on where the step ends

_ROW = types.Array(types.float64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")


@dataclass(frozen=True, slots=True)
class Step:
    """An exact step of a linear rig: ``transition`` (2n, 2n), ``begin`` and ``end`` (2n, n) for the bodies' forces."""

    transition: Real
    begin: Real
    end: Real


def exact_step(mass: Real, damping: Real, stiffness: Real, h: float) -> Step:
    """Return the step of length h (s) for masses (n,) kg, damping (n, n) N s/m and stiffness (n, n) N/m."""
    n = len(mass)
    a = np.zeros((2 * n, 2 * n))
    a[:n, n:] = np.eye(n)
    a[n:, :n], a[n:, n:] = -stiffness / mass[:, None], -damping / mass[:, None]
    b = np.zeros((2 * n, n))
    b[n:] = np.diag(1 / mass)
    # exp of [[A, B, 0], [0, 0, I], [0, 0, 0]] h holds the integrals of exp(A s) B and of exp(A s) B (h - s)
    big = np.zeros((4 * n, 4 * n))
    big[: 2 * n, : 2 * n], big[: 2 * n, 2 * n : 3 * n] = a * h, b * h
    big[2 * n : 3 * n, 3 * n :] = np.eye(n)
    grown = expm(big)
    whole, ramp = grown[: 2 * n, 2 * n : 3 * n], grown[: 2 * n, 3 * n :]
    return Step(
        np.ascontiguousarray(grown[: 2 * n, : 2 * n]),
        np.ascontiguousarray(whole - ramp),
        np.ascontiguousarray(ramp),
    )


@njit(
    [
        types.UniTuple(_TABLE, 2)(
            types.UniTuple(types.FunctionType(LAW), SLOTS),
            types.Array(int64, 1, "C"),
            _TABLE,
            _TABLE,
            _TABLE,
            _TABLE,
            _TABLE,
            _TABLE,
            types.boolean,
            _ROW,
            float64,
            float64,
            int64,
            _TABLE,
        )
    ],
    cache=True,
)
def forced_march(laws, element, p, rows, transition, begin, end, force, held, start, t0, h, substeps, memory):  # type: ignore[no-untyped-def]
    """Return states (samples, 2n) and extra forces of the elements (samples, elements), N, at the samples.

    Parameters
    ----------
    laws, element, p
        Up to `SLOTS` laws, the element each acts in (-1: none), and their parameters (slots, any). Laws of one
        element follow each other: each takes the force that the one before leaves.
    rows
        (elements, n) deformation of each element for unit displacements of the bodies.
    transition, begin, end
        See `Step`.
    force
        Forces on the bodies by the inputs, N: (samples, n) if ``held`` (constant until the next sample), else
        ((samples - 1) * substeps + 1, n), straight lines between.
    start, memory
        (2n,) state and (slots, MEMORY) memories at the first sample, t0 (s).
    """
    size = len(start)
    n = size // 2
    elements = len(rows)
    slots = len(element)
    samples = len(force) if held else (len(force) - 1) // substeps + 1
    states = np.zeros((samples, size))
    extras = np.zeros((samples, elements))
    z, ahead, base = start.copy(), start.copy(), start.copy()
    before, after = memory.copy(), memory.copy()
    now, new, last = np.zeros(elements), np.zeros(elements), np.zeros(elements)
    on_now, on_new = np.zeros(n), np.zeros(n)
    steps = (samples - 1) * substeps
    for step in range(steps + 1):
        if step > 0:
            for i in range(size):
                total = 0.0
                for j in range(size):
                    total += transition[i, j] * z[j]
                for j in range(n):
                    first = force[(step - 1) // substeps, j] if held else force[step - 1, j]
                    second = first if held else force[step, j]
                    total += begin[i, j] * (first + on_now[j]) + end[i, j] * second
                base[i] = total
            for i in range(elements):
                new[i] = 2 * now[i] - last[i]
        for _ in range(1 if step == 0 else CORRECTIONS):
            if step > 0:
                for j in range(n):
                    total = 0.0
                    for i in range(elements):
                        total -= rows[i, j] * new[i]
                    on_new[j] = total
                for i in range(size):
                    total = base[i]
                    for j in range(n):
                        total += end[i, j] * on_new[j]
                    ahead[i] = total
            for k in range(slots):
                i = element[k]
                if i < 0:
                    continue
                first_here = True
                for m in range(k):
                    if element[m] == i:
                        first_here = False
                if not first_here:
                    continue
                d, v = 0.0, 0.0
                for j in range(n):
                    d += rows[i, j] * ahead[j]
                    v += rows[i, j] * ahead[n + j]
                linear = p[k, STIFFNESS] * d + p[k, DAMPING] * v
                total = linear
                for m in range(k, slots):
                    if element[m] == i:
                        total = laws[m](total, d, v, t0 + step * h, p[m], before[m], after[m])
                new[i] = total - linear
        for k in range(slots):
            for m in range(MEMORY):
                before[k, m] = after[k, m]
        for i in range(size):
            z[i] = ahead[i]
        for i in range(elements):
            last[i] = now[i]
            now[i] = new[i]
        for j in range(n):
            total = 0.0
            for i in range(elements):
                total -= rows[i, j] * now[i]
            on_now[j] = total
        if step % substeps == 0:
            at = step // substeps
            for i in range(size):
                states[at, i] = z[i]
            for i in range(elements):
                extras[at, i] = now[i]
        if not abs(z[0]) < 1e300:
            break
    return states, extras
