"""Linear modes driven by given forces, exactly: what extra forces do to filtered channels, and free ringing."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, njit, types

from sim_backend.arrays import Complex, Real

_ROW = types.Array(types.float64, 1, "C")
_STACK = types.Array(types.float64, 3, "C")
_COMPLEX_TABLE = types.Array(types.complex128, 2, "C")
_COMPLEX_STACK = types.Array(types.complex128, 3, "C")
SMALL, TERMS = 0.1, 8  # |s h| below which the weights are summed as series, of so many terms
NOTHING = 1e-200  # N, and of what is left of a mode: below, numbers lose digits and take a hundred times as long
EXACT = 64  # steps after which powers of e^(s h) begin anew


def step_weights(poles: Complex, h: float) -> Complex:
    """Return (..., 4, p) ``e^(s h)`` and the weights of a force's start, end and bend over a step, of poles (..., p).

    They are integrals over the step of ``e^(s (h - t))`` times ``1 - u``, ``u`` and ``u (u - 1)`` with ``u = t / h``.
    """
    z = poles * h
    small = np.abs(z) < SMALL
    safe = np.where(small, 1.0, z)
    e = np.exp(z)
    phi1 = np.where(small, _series(z, 1), (np.exp(safe) - 1) / safe)
    phi2 = np.where(small, _series(z, 2), (phi1 - 1) / safe)
    phi3 = np.where(small, _series(z, 3), (phi2 - 0.5) / safe)
    return np.stack([e, h * (phi1 - phi2), h * phi2, h * (2 * phi3 - phi2)], axis=-2)


def _series(z: Complex, order: int) -> Complex:
    """Return ``sum z^k / (k + order)!``, for small z."""
    total = np.zeros_like(z)
    for k in range(TERMS - 1, -1, -1):
        total = total * z + 1 / math.factorial(k + order)
    return total


def parabolas(forces: Real) -> Real:
    """Return bends (..., n - 1) such that each step is the parabola through its ends and the value before them."""
    bends = np.zeros((*forces.shape[:-1], forces.shape[-1] - 1))
    bends[..., 1:] = 0.5 * np.diff(forces, 2, axis=-1)
    return bends


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
    [_STACK(_STACK, _STACK, _COMPLEX_STACK, types.Array(types.complex128, 4, "C"), _ROW, _STACK, int64)],
    cache=True,
    nogil=True,
)
def respond(force, bends, weights, residues, pairs, direct, substeps):  # type: ignore[no-untyped-def]
    """Return (runs, channels, samples) the response from rest to given forces.

    Parameters
    ----------
    force, bends
        (runs, elements, n) at every substep, and (runs, elements, n - 1) of `sim_backend.propagate.Motion`.
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
            f, bend = force[run, i], bends[run, i]
            b[:] = 0.0
            for n in range(count):
                if n > 0:
                    before, now, bent = f[n - 1], f[n], bend[n - 1]
                    quiet = abs(before) < NOTHING and abs(now) < NOTHING and abs(bent) < NOTHING
                    for j in range(poles):
                        b[j] *= w[0, j]
                        if not quiet:
                            b[j] += w[1, j] * before + w[2, j] * now + w[3, j] * bent
                        elif abs(b[j].real) < NOTHING and abs(b[j].imag) < NOTHING:
                            b[j] = 0.0
                if n % substeps == 0:
                    k = n // substeps
                    for c in range(channels):
                        total = direct[run, i, c] * f[n]
                        for j in range(poles):
                            total += pairs[j] * (residues[run, i, c, j] * b[j]).real
                        out[run, c, k] += total
    return out
