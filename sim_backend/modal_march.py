"""A linear rig carried along exactly in its modes, with extra forces in its elements: compiled.

Between substeps the extra forces are taken as straight lines, for which the step of a mode with pole s is exact:
``b_(n+1) = e^(s h) b_n + w0 f_n + w1 f_(n+1)``. What is left out is of the order of the step squared times the extra
force alone; the linear rig itself is never approximated.
"""

from __future__ import annotations

import warnings

import numpy as np
from numba import float64, int64, njit, types
from numba.core.errors import NumbaExperimentalFeatureWarning
from numpy.typing import NDArray

warnings.filterwarnings("ignore", category=NumbaExperimentalFeatureWarning)

Complex = NDArray[np.complex128]

_ROW = types.Array(types.float64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")
_COMPLEX_ROW = types.Array(types.complex128, 1, "C")
_COMPLEX_TABLE = types.Array(types.complex128, 2, "C")
LAW = float64(float64, float64, float64, float64, _ROW, _ROW, _ROW)
"""force so far (N, about rest), deformation (m), its rate (m/s), time since the tap (s), parameters, memory before the
step, memory after it -> force (N). The parameters begin with `REST`."""
PRELOAD, STIFFNESS, DAMPING, STEP = range(4)
REST = 4  # places taken by preload (N), stiffness (N/m), damping (N s/m) and time step (s) of the element
MEMORY = 24  # most numbers that a law may remember
SLOTS = 4  # most laws at work together
CORRECTIONS = 2  # passes over each step: the law's force depends on where the step ends


@njit(LAW, cache=True)
def no_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Leave the force as it is."""
    return force


def step_weights(poles: Complex, h: float) -> tuple[Complex, Complex, Complex]:
    """Return ``e^(s h)``, ``w0`` and ``w1`` of each pole for a force that is a straight line over a step."""
    z = poles * h
    small = np.abs(z) < 1e-3
    safe = np.where(small, 1.0, z)
    e = np.exp(z)
    phi1 = np.where(small, 1 + z / 2 + z**2 / 6 + z**3 / 24, (np.exp(safe) - 1) / safe)
    phi2 = np.where(small, 0.5 + z / 6 + z**2 / 24 + z**3 / 120, (np.exp(safe) - 1 - safe) / safe**2)
    first, second = np.asarray(h * (phi1 - phi2), np.complex128), np.asarray(h * phi2, np.complex128)
    return np.asarray(e, np.complex128), first, second


_LAWS = types.UniTuple(types.FunctionType(LAW), SLOTS)


@njit(
    [
        _TABLE(
            _LAWS,
            types.Array(int64, 1, "C"),
            _TABLE,
            _COMPLEX_TABLE,
            _COMPLEX_TABLE,
            _COMPLEX_TABLE,
            _COMPLEX_ROW,
            _COMPLEX_ROW,
            _COMPLEX_ROW,
            _COMPLEX_ROW,
            _ROW,
            float64,
            float64,
            int64,
            _TABLE,
        )
    ],
    cache=True,
)
def march(laws, element, p, seen, rate, drive, e, w0, w1, start, weight, t0, h, steps, memory):  # type: ignore[no-untyped-def]
    """Return the extra force of each element, (elements, steps + 1), N, from the start on.

    Parameters
    ----------
    laws, element, p
        Up to `SLOTS` laws, the element each acts in (-1: none), and their parameters. Laws of one element follow each
        other: each takes the force that the one before leaves.
    seen, rate
        (elements, poles) deformation and its rate for each modal amplitude.
    drive
        (elements, poles) what a unit force in an element does to each modal amplitude.
    e, w0, w1, start, weight
        (poles,): see `step_weights`; modal amplitudes at t0; 2 for a conjugate pair, 1 for a real pole.
    memory
        (laws, MEMORY) the laws' memories at t0.
    """
    elements, poles = seen.shape
    slots = len(element)
    extra = np.zeros((elements, steps + 1))
    b, ahead = start.copy(), start.copy()
    before, after = memory.copy(), memory.copy()
    now, new = np.zeros(elements), np.zeros(elements)
    for n in range(steps + 1):
        if n > 0:
            for i in range(elements):
                new[i] = now[i]
        for _ in range(1 if n == 0 else CORRECTIONS):
            if n > 0:
                for j in range(poles):
                    total = e[j] * b[j]
                    for i in range(elements):
                        total += drive[i, j] * (w0[j] * now[i] + w1[j] * new[i])
                    ahead[j] = total
            for i in range(elements):
                d, v = 0.0, 0.0
                for j in range(poles):
                    d += weight[j] * (seen[i, j] * ahead[j]).real
                    v += weight[j] * (rate[i, j] * ahead[j]).real
                linear, force = 0.0, 0.0
                for k in range(slots):
                    if element[k] == i:
                        linear = p[k, STIFFNESS] * d + p[k, DAMPING] * v
                        break
                force = linear
                for k in range(slots):
                    if element[k] == i:
                        force = laws[k](force, d, v, t0 + n * h, p[k], before[k], after[k])
                new[i] = force - linear
        for k in range(slots):
            for m in range(MEMORY):
                before[k, m] = after[k, m]
        for j in range(poles):
            b[j] = ahead[j]
        for i in range(elements):
            now[i] = new[i]
            extra[i, n] = new[i]
    return extra


@njit(
    [_ROW(types.FunctionType(LAW), _ROW, _ROW, _ROW, float64, float64, _ROW)],
    cache=True,
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


@njit(
    [_TABLE(_ROW, _COMPLEX_ROW, _COMPLEX_ROW, _COMPLEX_ROW, _COMPLEX_TABLE, _ROW, _ROW, int64)],
    cache=True,
)
def respond(force, e, w0, w1, residues, weight, direct, substeps):  # type: ignore[no-untyped-def]
    """Return (channels, samples) the response from rest to a force given at every substep."""
    poles, channels = len(e), len(residues)
    samples = (len(force) - 1) // substeps + 1
    out = np.zeros((channels, samples))
    b = np.zeros(poles, np.complex128)
    for n in range(len(force)):
        if n > 0:
            for j in range(poles):
                b[j] = e[j] * b[j] + w0[j] * force[n - 1] + w1[j] * force[n]
        if n % substeps == 0:
            k = n // substeps
            for c in range(channels):
                total = direct[c] * force[n]
                for j in range(poles):
                    total += weight[j] * (residues[c, j] * b[j]).real
                out[c, k] = total
    return out
