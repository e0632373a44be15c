"""Force laws that no list of mechanisms holds, each from its physics; as in `mesotap.proof.generator.laws`.

`laws.push` and `laws.remember` hand on to these. A law's own numbers begin at p[3].
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

Real = NDArray[np.float64]

FIRST = 100
"""Laws from this number on are those of this module."""
STEEPEST = 30.0  # ranges of an exponential; beyond it no machine is whole


class Unlisted(IntEnum):
    """Laws that `push` knows."""

    SQUARED_DEFORMATION = FIRST
    DEAD_ZONE = FIRST + 1
    EXPONENTIAL_RANGE = FIRST + 2
    POWER_OF_RATE = FIRST + 3
    STRIBECK = FIRST + 4
    BOUC_WEN = FIRST + 5
    LUGRE = FIRST + 6
    TOUCHING = FIRST + 7
    HELD = FIRST + 8


_SQUARED, _DEAD_ZONE, _RANGE = (
    int(Unlisted.SQUARED_DEFORMATION),
    int(Unlisted.DEAD_ZONE),
    int(Unlisted.EXPONENTIAL_RANGE),
)
_POWER, _STRIBECK = int(Unlisted.POWER_OF_RATE), int(Unlisted.STRIBECK)
_BOUC_WEN, _LUGRE = int(Unlisted.BOUC_WEN), int(Unlisted.LUGRE)
_TOUCHING, _HELD = int(Unlisted.TOUCHING), int(Unlisted.HELD)


@njit
def dead_zone(p: Real, d: float) -> float:
    """Another spring p[3] (N/m) that is met beyond the clearance p[4] (m), on either side."""
    return p[3] * (d - min(max(d, -p[4]), p[4]))


@njit
def exponential_range(p: Real, d: float) -> float:
    """Force k l (exp(d / l) - 1 - d / l) of a range l of its own: p[3] = k (N/m), p[4] = l (m)."""
    u = min(d / p[4], STEEPEST)
    return p[3] * p[4] * (math.exp(u) - 1.0 - u)


@njit
def power_of_rate(p: Real, v: float) -> float:
    """Damping c |v|^a against the rate; p[3] = c (N (s/m)^a), p[4] = a, rounded off below the rate p[5] (m/s)."""
    return p[3] * v * (v * v + p[5] * p[5]) ** ((p[4] - 1.0) / 2.0)


@njit
def sliding(p: Real, v: float) -> float:
    """Force at which a joint slides (Stribeck): p[3] + p[4] exp(-(v / p[5])^2), N, N, m/s."""
    return p[3] + p[4] * math.exp(-((v / p[5]) ** 2))


@njit
def stribeck(p: Real, v: float) -> float:
    """Friction that first falls and then rises with the rate, p[7] in N s/m; rounded off below the rate p[6]."""
    return sliding(p, v) * math.tanh(v / p[6]) + p[7] * v


@njit
def lugre(p: Real, v: float, z: float) -> float:
    """Bristles (Canudas de Wit): s0 z + s1 z', z' = v - s0 |v| z / g(v); p[6] = s0 (N/m), p[7] = s1 (N s/m)."""
    return p[6] * z + p[7] * (v - p[6] * abs(v) * z / sliding(p, v))


@njit
def touching(p: Real, d: float, v: float) -> float:
    """A tip of stiffness p[3] (N/m) that pushes while it touches, more as it comes, by p[4] (s/m), than as it goes."""
    return max(p[3] * d * (1.0 + p[4] * v), 0.0) if d > 0.0 else 0.0


@njit
def push(law: int, p: Real, t: float, d: float, v: float, m: Real) -> float:
    """Return the force of a law, N."""
    if law == _SQUARED:
        return p[3] * d * d
    if law == _DEAD_ZONE:
        return dead_zone(p, d)
    if law == _RANGE:
        return exponential_range(p, d)
    if law == _POWER:
        return power_of_rate(p, v)
    if law == _STRIBECK:
        return stribeck(p, v)
    if law == _BOUC_WEN:
        return p[3] * (m[0] - d)
    if law == _LUGRE:
        return lugre(p, v, m[0])
    if law == _TOUCHING:
        return touching(p, d, v)
    return -p[3]  # held: a constant push


@njit
def remembers(law: int) -> bool:
    """Return whether a law has a memory."""
    return law in (_BOUC_WEN, _LUGRE)


@njit
def _bouc_wen_slope(p: Real, z: float, toward: float) -> float:
    """Return dz/dd = 1 - |z / z0|^n (beta sign(z d') + gamma); p[4:8] = z0 (m), n, beta, gamma."""
    along = 1.0 if z * toward >= 0.0 else -1.0
    return 1.0 - abs(z / p[4]) ** p[5] * (p[6] * along + p[7])


@njit
def bouc_wen(p: Real, z: float, step: float) -> float:
    """Return Bouc and Wen's variable, m, after the deformation has changed by ``step``: Runge and Kutta's rule."""
    a = _bouc_wen_slope(p, z, step)
    b = _bouc_wen_slope(p, z + step / 2 * a, step)
    c = _bouc_wen_slope(p, z + step / 2 * b, step)
    e = _bouc_wen_slope(p, z + step * c, step)
    return z + step / 6 * (a + 2 * b + 2 * c + e)


@njit
def remember(law: int, p: Real, i: int, before: float, d0: float, d: float, elapsed: float) -> float:
    """Return memory i after the link's deformation went from d0 to d within ``elapsed`` s."""
    if i > 0 or elapsed <= 0.0:
        return before
    if law == _BOUC_WEN:
        return bouc_wen(p, before, d - d0)
    v = (d - d0) / elapsed
    decay = p[6] * abs(v) / sliding(p, v) * elapsed
    if decay < 1e-12:
        return before + d - d0
    return before * math.exp(-decay) - (d - d0) * math.expm1(-decay) / decay
