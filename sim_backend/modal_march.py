"""A linear rig carried along exactly in its modes, with extra forces in its elements: compiled.

Over a substep an extra force is the parabola through its last three values, for which the step of a mode with pole s
is exact: ``b_(n+1) = e^(s h) b_n + w0 f_n + w1 f_(n+1) + w2 (f_(n+1) - 2 f_n + f_(n-1))``. What is left out is of the
order of the step cubed times the extra force alone; the linear rig itself is never approximated.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
from numba import float64, int64, njit, types
from numba.core.errors import NumbaExperimentalFeatureWarning
from numpy.typing import NDArray

warnings.filterwarnings("ignore", category=NumbaExperimentalFeatureWarning)

Complex = NDArray[np.complex128]

_ROW = types.Array(types.float64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")
_STACK = types.Array(types.float64, 3, "C")
_COMPLEX_TABLE = types.Array(types.complex128, 2, "C")
_COMPLEX_STACK = types.Array(types.complex128, 3, "C")
LAW = float64(float64, float64, float64, float64, _ROW, _ROW, _ROW)
"""force so far (N, about rest), deformation (m), its rate (m/s), time since the tap (s), parameters, memory before the
step, memory after it -> force (N). The parameters begin with `REST`."""
PRELOAD, STIFFNESS, DAMPING, STEP = range(4)
REST = 4  # places taken by preload (N), stiffness (N/m), damping (N s/m) and time step (s) of the element
MEMORY = 24  # most numbers that a law may remember
SLOTS = 4  # most laws at work together
SMALL, TERMS = 0.1, 8  # |s h| below which the weights are summed as series, of so many terms
EXACT = 64  # steps after which powers of e^(s h) begin anew
CORRECTIONS = 2  # passes over each step: the law's force depends on where the step ends


@njit(LAW, cache=True)
def no_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Leave the force as it is."""
    return force


def step_weights(poles: Complex, h: float) -> Complex:
    """Return (..., 4, p) ``e^(s h)``, ``w0``, ``w1`` and ``w2`` of poles (..., p) for a force that is a parabola.

    They are integrals of ``e^(s (h - t))`` times 1, ``t / h`` and ``(t / h)^2`` over the step.
    """
    z = poles * h
    small = np.abs(z) < SMALL
    safe = np.where(small, 1.0, z)
    e = np.exp(z)
    phi1 = np.where(small, _series(z, 1), (np.exp(safe) - 1) / safe)
    phi2 = np.where(small, _series(z, 2), (phi1 - 1) / safe)
    phi3 = np.where(small, _series(z, 3), (phi2 - 0.5) / safe)
    return np.stack([e, h * (phi1 - phi2), h * phi2, h * (phi3 - phi2 / 2)], axis=-2)


def _series(z: Complex, order: int) -> Complex:
    """Return ``sum z^k / (k + order)!``, for small z."""
    total = np.zeros_like(z)
    for k in range(TERMS - 1, -1, -1):
        total = total * z + 1 / math.factorial(k + order)
    return total


_LAWS = types.UniTuple(types.FunctionType(LAW), SLOTS)


@njit(
    [
        _STACK(
            _LAWS,
            types.Array(int64, 1, "C"),
            _STACK,
            _COMPLEX_STACK,
            _COMPLEX_STACK,
            _COMPLEX_STACK,
            _COMPLEX_STACK,
            _COMPLEX_TABLE,
            _ROW,
            _ROW,
            float64,
            int64,
            _TABLE,
            types.Array(int64, 1, "C"),
            _COMPLEX_TABLE,
        )
    ],
    cache=True,
    nogil=True,
)
def march(  # type: ignore[no-untyped-def]
    laws, element, p, seen, rate, drive, weights, start, pairs, t0, h, steps, memory, struck, blow
):
    """Return the extra force of each element in some runs, (runs, elements, steps + 1), N, from the start on.

    Parameters
    ----------
    laws, element
        Up to `SLOTS` laws and the element each acts in (-1: none). Laws of one element follow each other: each takes
        the force that the one before leaves.
    p
        (runs, slots, any) the laws' parameters.
    seen, rate
        (runs, elements, poles) deformation and its rate for each modal amplitude.
    drive
        (runs, elements, poles) what a unit force in an element does to each modal amplitude.
    weights
        (runs, 4, poles) of `step_weights`.
    start, pairs
        (runs, poles) modal amplitudes at t0; (poles,) 2 for a conjugate pair, 1 for a real pole.
    t0
        (runs,) time since the tap of the start, s.
    memory
        (laws, MEMORY) the laws' memories at t0.
    struck, blow
        (runs,) step at which each rig is struck again (-1: never), and (runs, poles) what the modes gain by it.
    """
    runs, elements, poles = seen.shape
    slots = len(element)
    extra = np.zeros((runs, elements, steps + 1))
    base, ahead = np.empty(poles, np.complex128), np.empty(poles, np.complex128)
    last, now, new = np.empty(elements), np.empty(elements), np.empty(elements)
    for run in range(runs):
        w, own = weights[run], p[run]
        ahead[:] = start[run]
        before, after = memory.copy(), memory.copy()
        last[:], now[:], new[:] = 0.0, 0.0, 0.0
        for n in range(steps + 1):
            curved = 1.0 if n > 1 else 0.0  # two values say nothing of a curvature
            if n > 0:
                for j in range(poles):
                    total = w[0, j] * ahead[j]
                    for i in range(elements):
                        total += drive[run, i, j] * (w[1, j] * now[i] + curved * w[3, j] * (last[i] - 2 * now[i]))
                    base[j] = total + blow[run, j] if n == struck[run] else total
                for i in range(elements):
                    new[i] = now[i] + curved * (now[i] - last[i])
            for _ in range(1 if n == 0 else CORRECTIONS):
                if n > 0:
                    for j in range(poles):
                        total = base[j]
                        for i in range(elements):
                            total += drive[run, i, j] * (w[2, j] + curved * w[3, j]) * new[i]
                        ahead[j] = total
                for i in range(elements):
                    d, v = 0.0, 0.0
                    for j in range(poles):
                        d += pairs[j] * (seen[run, i, j] * ahead[j]).real
                        v += pairs[j] * (rate[run, i, j] * ahead[j]).real
                    linear = 0.0
                    for k in range(slots):
                        if element[k] == i:
                            linear = own[k, STIFFNESS] * d + own[k, DAMPING] * v
                            break
                    force = linear
                    for k in range(slots):
                        if element[k] == i:
                            force = laws[k](force, d, v, t0[run] + n * h, own[k], before[k], after[k])
                    new[i] = force - linear
            before[:, :] = after
            for i in range(elements):
                last[i] = now[i]
                now[i] = new[i]
                extra[run, i, n] = new[i]
    return extra


@njit(
    [_ROW(types.FunctionType(LAW), _ROW, _ROW, _ROW, float64, float64, _ROW)],
    cache=True,
    nogil=True,
)
def along(law, p, d, v, t0, h, memory):  # type: ignore[no-untyped-def]
    """Return the extra force (n,) of one law along a given deformation and rate, each (n,)."""
    before, after = memory.copy(), memory.copy()
    extra = np.empty(len(d))
    for n in range(len(d)):
        linear = p[STIFFNESS] * d[n] + p[DAMPING] * v[n]
        extra[n] = law(linear, d[n], v[n], t0 + n * h, p, before, after) - linear
        for m in range(MEMORY):
            before[m] = after[m]
    return extra


@njit([_COMPLEX_TABLE(types.Array(types.complex128, 1, "C"), float64, int64)], cache=True, nogil=True)
def waves(poles, h, count):  # type: ignore[no-untyped-def]
    """Return (count, poles) ``e^(s n h)``, by powers that begin anew every `EXACT` steps."""
    out = np.empty((count, len(poles)), np.complex128)
    for j in range(len(poles)):
        turn, now = np.exp(poles[j] * h), 1.0 + 0.0j
        for n in range(count):
            now = np.exp(poles[j] * (n * h)) if n % EXACT == 0 else now * turn
            out[n, j] = now
    return out


@njit(
    [_STACK(_STACK, _COMPLEX_STACK, types.Array(types.complex128, 4, "C"), _ROW, _STACK, int64)],
    cache=True,
    nogil=True,
)
def respond(force, weights, residues, pairs, direct, substeps):  # type: ignore[no-untyped-def]
    """Return (runs, channels, samples) the response from rest to forces (runs, elements, n) given at every substep.

    Parameters
    ----------
    weights, residues
        (runs, 4, poles) of `step_weights`; (runs, elements, channels, poles).
    pairs, direct
        (poles,) 2 for a conjugate pair, 1 for a real pole; (runs, elements, channels) what goes through at once.
    """
    runs, elements, channels, poles = residues.shape
    count = force.shape[2]
    out = np.zeros((runs, channels, (count - 1) // substeps + 1))
    b = np.empty(poles, np.complex128)
    for run in range(runs):
        w = weights[run]
        for i in range(elements):
            f = force[run, i]
            b[:] = 0.0
            for n in range(count):
                if n > 0:
                    bend = f[n] - 2 * f[n - 1] + f[n - 2] if n > 1 else 0.0
                    for j in range(poles):
                        b[j] = w[0, j] * b[j] + w[1, j] * f[n - 1] + w[2, j] * f[n] + w[3, j] * bend
                if n % substeps == 0:
                    k = n // substeps
                    for c in range(channels):
                        total = direct[run, i, c] * f[n]
                        for j in range(poles):
                            total += pairs[j] * (residues[run, i, c, j] * b[j]).real
                        out[run, c, k] += total
    return out
