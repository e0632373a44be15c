"""Forces beyond the linear ones, of deformation ``d`` and rate ``v`` of an element; positive ones push against ``d``.

=================  ==========================================================================  ==================
code               force                                                                       after
=================  ==========================================================================  ==================
CUBIC              p0 d^3                                                                      Duffing (1918)
SQUARE             p0 d^2
RATE_SQUARED       p0 v |v|                                                                    drag
FRICTION           p0 sign(v); stuck where less is enough                                      Coulomb
STOP               p0 (d - p1) beyond p1
SLIP               p0 in parallel Jenkins elements whose reaches are spread up to p1 with      Iwan (1966),
                   density ~ y^p2, less their joint stiffness                                  Segalman (2005)
SETTLING           (p0 d + p1 v)(1 - exp(-t / p2))
LOG_CREEP          p0 p1 ln(1 + t / p2) d
HERTZ              p0 ((1 + d / s)^1.5 - 1) - p1 d, s = 1.5 p0 / p1                            Hertz (1881)
ROUGH              p0 (exp(p1 d / p0) - 1) - p1 d                                              Greenwood and
                                                                                               Williamson (1966)
PARTING            max(-p0, p1 d + p2 v) - (p1 d + p2 v)
APPROACH_DAMPING   p0 (d / p1) v                                                               Hunt and Crossley
                                                                                               (1975)
FILM               p0 v ((1 - d / p1)^-3 - 1)                                                  Reynolds (1886)
MENISCUS           -p0 exp(-max(0, -d) / p1) (1 - tanh(v / p2)) / 2                            Orr et al. (1975)
RATE_CUBED         p0 v^3
REID               p0 |d| sign(v)                                                              Reid (1956)
VAN_DER_POL        p0 d^2 v
SHAKEN             p0 cos(p1 t + p2) d                                                         Mathieu (1868)
SWING              p0 (sin(p1 d) / p1 - d)                                                     pendulum
=================  ==========================================================================  ==================
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

CODES = (
    "CUBIC", "SQUARE", "RATE_SQUARED", "FRICTION", "STOP", "SLIP", "SETTLING", "LOG_CREEP", "HERTZ", "ROUGH", "PARTING",
    "APPROACH_DAMPING", "FILM", "MENISCUS", "RATE_CUBED", "REID", "VAN_DER_POL", "SHAKEN", "SWING",
)  # fmt: skip
(
    CUBIC, SQUARE, RATE_SQUARED, FRICTION, STOP, SLIP, SETTLING, LOG_CREEP, HERTZ, ROUGH, PARTING,
    APPROACH_DAMPING, FILM, MENISCUS, RATE_CUBED, REID, VAN_DER_POL, SHAKEN, SWING,
) = range(len(CODES))  # fmt: skip
KINKED = (FRICTION, STOP, SLIP, PARTING, MENISCUS, REID)
"""Laws whose force, or its slope, jumps: the integration stops at the jump."""
SLIDERS = 100
THINNEST_FILM = 0.02  # of its height at rest: a film that thin is not squeezed any further
STEEPEST = 50.0  # exponent of a rough surface beyond which it is as good as rigid

Array = NDArray[np.float64]


def reaches(law: int, constants: Array) -> Array:
    """Return the deformations at which the Jenkins elements of a slipping joint begin to slide, shape (SLIDERS,)."""
    if law != SLIP:
        return np.zeros(SLIDERS)
    return np.asarray(constants[1] * ((np.arange(SLIDERS) + 0.5) / SLIDERS) ** (1.0 / (constants[2] + 1.0)))


@njit(cache=True)
def slide(stretch: Array, reach: Array, step: float) -> None:
    """Move Jenkins elements by a step in one direction; those at their reach slide."""
    for i in range(SLIDERS):
        stretch[i] = min(max(stretch[i] + step, -reach[i]), reach[i])


@njit(cache=True)
def _slipping(d: float, p: Array, memory: Array) -> float:
    """Force of Jenkins elements, less their stiffness; ``memory``: reaches, stretches, the deformation they are of."""
    total = 0.0
    step = d - memory[2, 0]
    for i in range(SLIDERS):
        total += min(max(memory[1, i] + step, -memory[0, i]), memory[0, i])
    return p[0] * (total / SLIDERS - d)


@njit(cache=True)
def _of_contact(code: int, d: float, v: float, mode: float, p: Array) -> float:
    if code == HERTZ:
        static = 1.5 * p[0] / p[1]
        return p[0] * (max(0.0, 1.0 + d / static) ** 1.5 - 1.0) - p[1] * d
    if code == ROUGH:
        return p[0] * (np.exp(min(p[1] * d / p[0], STEEPEST)) - 1.0) - p[1] * d
    if code == PARTING:
        return 0.0 if mode > 0 else -p[0] - p[1] * d - p[2] * v
    if code == APPROACH_DAMPING:
        return p[0] * d / p[1] * v
    if code == FILM:
        return p[0] * v * (max(1.0 - d / p[1], THINNEST_FILM) ** -3 - 1.0)
    # meniscus
    away = 0.0 if mode > 0 else -d
    return -p[0] * np.exp(-away / p[1]) * 0.5 * (1.0 - np.tanh(v / p[2]))


@njit(cache=True)
def force(code: int, d: float, v: float, t: float, mode: float, p: Array, memory: Array) -> float:
    """Force of a law; ``mode`` is the side of its jump on which it is. Friction while stuck is none of these."""
    if code == CUBIC:
        return p[0] * d * d * d
    if code == SQUARE:
        return p[0] * d * d
    if code == RATE_SQUARED:
        return p[0] * v * abs(v)
    if code == FRICTION:
        return p[0] * mode
    if code == STOP:
        return p[0] * (d - p[1]) if mode > 0 else 0.0
    if code == SLIP:
        return _slipping(d, p, memory)
    if code == SETTLING:
        return (p[0] * d + p[1] * v) * (1.0 - np.exp(-t / p[2]))
    if code == LOG_CREEP:
        return p[0] * p[1] * np.log(1.0 + t / p[2]) * d
    if code == RATE_CUBED:
        return p[0] * v * v * v
    if code == REID:
        return p[0] * abs(d) * mode
    if code == VAN_DER_POL:
        return p[0] * d * d * v
    if code == SWING:
        return p[0] * (np.sin(p[1] * d) / p[1] - d) if p[1] else 0.0
    if code == SHAKEN:
        return p[0] * np.cos(p[1] * t + p[2]) * d
    return _of_contact(code, d, v, mode, p)


@njit(cache=True)
def side(code: int, d: float, v: float, p: Array) -> float:
    """Return what changes sign where a law has its jump."""
    if code == STOP:
        return d - p[1]
    if code == PARTING:
        return p[0] + p[1] * d + p[2] * v
    if code == MENISCUS:
        return d
    return v
