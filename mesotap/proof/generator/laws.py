"""Force laws beyond Eq. 9, each from its physics, for `mesotap.proof.generator.integration`.

A law acts in a link: two places of the rig whose relative motion it sees. Every law takes

``p``
    its numbers: preload P (N), stiffness k (N/m) and damping c (N s/m) of the link, then its own;
``t``
    time since the tap began, s;
``d``, ``v``
    deformation (m, positive: pressed together beyond rest) and its rate (m/s);
``m``
    its memory (`MEMORY` numbers);
``force``
    what the link already bears beyond rest, linear part included, N;

and returns the force to add, N, positive where it pushes the two places apart.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesotap.proof.generator import unlisted_laws

Real = NDArray[np.float64]

MEMORY = 8  # numbers that a law may remember
UNLISTED = unlisted_laws.FIRST  # from here on the laws are of `unlisted_laws`
push_unlisted, remember_unlisted, unlisted_remembers = (
    unlisted_laws.push,
    unlisted_laws.remember,
    unlisted_laws.remembers,
)
OWN = 3  # place of a law's own numbers in ``p``
CREVICE = 0.05  # of the film at rest: as thin as it gets


class Law(IntEnum):
    """Laws that `push` knows."""

    HERTZ = 0
    EXPONENTIAL = 1
    PARTING = 2
    GROWING_DAMPING = 3
    SLIDERS = 4
    DRAG = 5
    FILM = 6
    MENISCUS = 7
    CREEP = 8
    DRY_FRICTION = 9
    DASHPOT = 10
    CUBED_DEFORMATION = 11
    BILINEAR = 12
    DRIFTING = 13
    CUBED_RATE = 14
    MODULATED = 15
    STEP = 16
    LEAKING = 17
    YIELDING = 18
    ATTRACTION = 19


_HERTZ, _EXPONENTIAL, _PARTING, _GROWING = (
    int(Law.HERTZ),
    int(Law.EXPONENTIAL),
    int(Law.PARTING),
    int(Law.GROWING_DAMPING),
)
_SLIDERS, _DRAG, _FILM, _MENISCUS = int(Law.SLIDERS), int(Law.DRAG), int(Law.FILM), int(Law.MENISCUS)
_CREEP, _FRICTION, _DASHPOT, _CUBED = (
    int(Law.CREEP),
    int(Law.DRY_FRICTION),
    int(Law.DASHPOT),
    int(Law.CUBED_DEFORMATION),
)
_BILINEAR, _DRIFTING = int(Law.BILINEAR), int(Law.DRIFTING)
_CUBED_RATE, _MODULATED, _STEP = int(Law.CUBED_RATE), int(Law.MODULATED), int(Law.STEP)
_LEAKING, _YIELDING, _ATTRACTION = int(Law.LEAKING), int(Law.YIELDING), int(Law.ATTRACTION)


@njit
def hertz(p: Real, d: float) -> float:
    """Sphere on flat: F = P (1 + d / s)^(3/2), s = 3 P / (2 k) the static approach; nothing when apart."""
    approach = 1.0 + d * p[1] / (1.5 * p[0])
    return (p[0] * approach**1.5 if approach > 0.0 else 0.0) - p[0] - p[1] * d


@njit
def exponential(p: Real, d: float) -> float:
    """Rough surfaces with an exponential tail of heights: F = P exp(k d / P)."""
    return p[0] * math.exp(p[1] * d / p[0]) - p[0] - p[1] * d


@njit
def parting(p: Real, force: float) -> float:
    """Surfaces that cannot pull: the whole contact force P + F is never below zero."""
    return -p[0] - force if p[0] + force < 0.0 else 0.0


@njit
def growing_damping(p: Real, d: float, v: float) -> float:
    """Damper in proportion to the approach: c (1 + g k d / P), never negative; p[3] = g."""
    growth = p[3] * p[1] * d / p[0]
    return p[2] * max(growth, -1.0) * v


@njit
def sliders(p: Real, d: float, m: Real) -> float:
    """Springs that each slide at a limit of their own, in the place of part of the stiffness (Iwan; one: Jenkins).

    p[3] is the stiffness that slides (N/m), p[4] the largest deformation at which one still sticks (m), p[5] their
    number, with limits evenly below that; ``m`` holds their deformations.
    """
    count = int(p[5])
    held = 0.0
    for i in range(count):
        held += m[i]
    return p[3] * (held / count - d)


@njit
def drag(p: Real, v: float) -> float:
    """Force of the rate squared, against it; p[3] in N s2/m2."""
    return p[3] * v * abs(v)


@njit
def film(p: Real, d: float, v: float) -> float:
    """Squeeze film (Reynolds, two plates): its damping grows as the third power of rest gap over gap.

    p[3] is its damping at rest (N s/m), part of the link's; p[4] its gap at rest (m).
    """
    gap = max(1.0 - d / p[4], CREVICE)
    return p[3] * (1.0 / gap**3 - 1.0) * v


@njit
def meniscus(p: Real, d: float, v: float) -> float:
    """Attraction on the way out only: menisci stretch and break as the surfaces part, and do not pull as they close.

    p[3] (N) while pressed beyond rest, decaying with the range p[4] (m) as the surfaces part; it sets in and ceases
    within the rate p[5] (m/s). What it is at rest belongs to the preload.
    """
    opening = 0.5 * (1.0 - math.tanh(v / p[5]))
    return p[3] * (0.5 - opening * math.exp(min(d, 0.0) / p[4]))


@njit
def creep(p: Real, t: float, d: float) -> float:
    """Stiffness that recovers after the tap as the logarithm of time: k b ln(1 + t / tau); p[3] = b, p[4] = tau."""
    return p[1] * p[3] * math.log1p(t / p[4]) * d


@njit
def dry_friction(p: Real, v: float) -> float:
    """Coulomb friction p[3] (N), rounded off below the rate p[4] (m/s)."""
    return p[3] * math.tanh(v / p[4])


@njit
def bilinear(p: Real, d: float) -> float:
    """Another stiffness when pressed than when pulled: p[3] is the difference over k."""
    return p[1] * p[3] * d if d > 0.0 else 0.0


@njit
def modulated(p: Real, t: float, d: float) -> float:
    """Stiffness that something shakes: k b sin(w t + phase); p[3:6] = b, w, phase."""
    return p[1] * p[3] * math.sin(p[4] * t + p[5]) * d


@njit
def leaking(p: Real, m: Real) -> float:
    """Springs that leak, f' = k v - f / tau each; p[3] their number, then k (N/m) and tau (s) of each; ``m``: f."""
    total = 0.0
    for i in range(int(p[3])):
        total += m[i]
    return total


@njit
def attraction(p: Real, d: float) -> float:
    """Attraction p[3] (N) while pressed, falling off with the gap within the range p[4] (m), on the way in as out."""
    return p[3] * (1.0 - math.exp(min(d, 0.0) / p[4]))


@njit
def push(law: int, p: Real, t: float, d: float, v: float, m: Real, force: float) -> float:
    """Return the force of a law, N."""
    if law >= UNLISTED:
        return push_unlisted(law, p, t, d, v, m)
    if law == _HERTZ:
        return hertz(p, d)
    if law == _EXPONENTIAL:
        return exponential(p, d)
    if law == _PARTING:
        return parting(p, force)
    if law == _GROWING:
        return growing_damping(p, d, v)
    if law == _SLIDERS:
        return sliders(p, d, m)
    if law == _DRAG:
        return drag(p, v)
    if law == _FILM:
        return film(p, d, v)
    if law == _MENISCUS:
        return meniscus(p, d, v)
    if law == _CREEP:
        return creep(p, t, d)
    if law == _FRICTION:
        return dry_friction(p, v)
    if law == _DASHPOT:
        return p[3] * v
    if law == _CUBED:
        return p[3] * d**3
    if law == _BILINEAR:
        return bilinear(p, d)
    if law == _DRIFTING:
        return p[1] * p[3] * (1.0 - math.exp(-t / p[4])) * d
    if law == _CUBED_RATE:
        return p[3] * v**3
    if law == _MODULATED:
        return modulated(p, t, d)
    if law == _LEAKING:
        return leaking(p, m)
    if law == _YIELDING:
        return -p[1] * p[3] * m[0]
    if law == _ATTRACTION:
        return attraction(p, d)
    return p[1] * p[3] * d if t > p[4] else 0.0


@njit
def remembers(law: int) -> bool:
    """Return whether a law has a memory."""
    return unlisted_remembers(law) if law >= UNLISTED else law in (_SLIDERS, _LEAKING, _YIELDING)


@njit
def remember(law: int, p: Real, i: int, before: float, d0: float, d: float, elapsed: float) -> float:
    """Return memory i after the link's deformation went from d0 to d within ``elapsed`` s.

    Of springs that leak the force, of what yields the largest deformation, of sliders the deformation of each.
    """
    if law >= UNLISTED:
        return remember_unlisted(law, p, i, before, d0, d, elapsed)
    if law == _LEAKING:
        if i >= p[3] or elapsed <= 0.0:
            return before
        tau = p[5 + 2 * i]
        left = math.exp(-elapsed / tau)
        return before * left + p[4 + 2 * i] * (d - d0) / elapsed * tau * (1.0 - left)
    if law == _YIELDING:
        return max(before, d)
    limit = p[4] * (i + 1) / p[5]
    return min(max(before + d - d0, -limit), limit)
