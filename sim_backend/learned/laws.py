"""Compiled laws of the families that are learned from; see `sim_backend.force_law.LAW` for their arguments.

Deformation and rate are counted in a reference (m, m/s) among the parameters, forces in that at the reference.
"""

from __future__ import annotations

import math

from numba import njit

from sim_backend.force_law import REST
from sim_backend.mechanisms.kinds import law

STRENGTH, FIRST, SECOND, OF_D, OF_V, ODD_D, ODD_V = range(REST, REST + 7)
LARGEST_EXPONENT = 50.0  # of an exponential: beyond, a trial step of a fit has gone astray
PARTS = 4  # of a step, in which hysteresis is followed
AT_ONCE = 0.02  # of the reference rate, within which friction changes its sign
SHARPLY = 1e-4  # likewise, of one that grows with the deflection and is as sharp when a motion has faded


@njit(cache=True)
def _power(x, exponent, odd):  # type: ignore[no-untyped-def]
    """|x|^exponent, with the sign of x if it is odd."""
    if exponent == 0.0 and odd == 0.0:
        return 1.0
    size = abs(x) ** exponent if x != 0.0 else 0.0
    return -size if odd > 0.0 and x < 0.0 else size


@law
def product_of_powers(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """w |d/D|^n |v/V|^m, each with its sign where it is odd."""
    x, y = d / p[OF_D], v / p[OF_V]
    return force + p[STRENGTH] * _power(x, p[FIRST], p[ODD_D]) * _power(y, p[SECOND], p[ODD_V])


@law
def exponential(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """2 w (e^(a d/D) - 1 - a d/D) / a^2: w (d/D)^2 for a small a."""
    a = p[FIRST] if abs(p[FIRST]) > 1e-3 else 1e-3
    x = a * d / p[OF_D]
    grown = math.expm1(x) if x < LARGEST_EXPONENT else math.expm1(LARGEST_EXPONENT)
    return force + 2.0 * p[STRENGTH] * (grown - x) / (a * a)


@law
def power_of_approach(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """P (1 + k d / (n P))^n in the place of P + k d under a load P with the stiffness k; nothing beyond separation.

    Hertz' contact with n = 3/2 (Johnson, Contact Mechanics, chapter 5). p[4] = n.
    """
    n = p[REST]
    u = 1.0 + p[1] * d / (n * p[0])
    pressed = p[0] * (u**n - 1.0) if u > 0.0 else -p[0]
    return force + pressed - p[1] * d


@law
def dead_zone(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """w (|d/D| - g) with the sign of d beyond the play g, nothing within."""
    x = d / p[OF_D]
    beyond = abs(x) - p[FIRST]
    if beyond <= 0.0:
        return force
    return force + p[STRENGTH] * (beyond if x > 0.0 else -beyond)


@law
def friction(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Dry friction w (1 + b e^-(v/V_s)^2) against the rate, V_s = s V (Stribeck)."""
    y = v / p[OF_V]
    return force + p[STRENGTH] * math.tanh(y / AT_ONCE) * (1.0 + p[FIRST] * math.exp(-((y / p[SECOND]) ** 2)))


@law
def growing_friction(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """w |d/D|^n against the rate, whatever its size (Reid, J. R. Aeronaut. Soc. 60 (1956) 283, with n = 1)."""
    return force + p[STRENGTH] * _power(d / p[OF_D], p[FIRST], 0.0) * math.tanh(v / p[OF_V] / SHARPLY)


@law
def hysteresis(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """w (z - d/D), z' = (1 - |z|^n (1 - b + b sign(z v))) v/D: Bouc and Wen; p[4:7] = w, n, b. Memory: z, d.

    The stiffness of small motions belongs to the element.
    """
    step = (d - before[1]) / p[OF_D] / PARTS
    z, n, b = before[0], p[FIRST], p[SECOND]
    way = 1.0 if step > 0.0 else -1.0
    for _ in range(PARTS):
        half = z + 0.5 * step * (1.0 - abs(z) ** n * (1.0 - b + b * (way if z > 0.0 else -way)))
        z = z + step * (1.0 - abs(half) ** n * (1.0 - b + b * (way if half > 0.0 else -way)))
        z = min(max(z, -3.0), 3.0)
    after[0], after[1] = z, d
    return force + p[STRENGTH] * (z - d / p[OF_D])


@law
def fading(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """(w d/D + u v/V) (1 - e^(-t / tau)); p[4:7] = w, u, tau: what the element gains with time."""
    return force + (p[STRENGTH] * d / p[OF_D] + p[FIRST] * v / p[OF_V]) * -math.expm1(-t / p[SECOND])


@law
def of_a_duration(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """(w d/D + u v/V) until tau after the tap, where it ends within a tenth of tau; p[4:7] = w, u, tau."""
    here = 0.5 - 0.5 * math.tanh((t / p[SECOND] - 1.0) / 0.05)
    return force + (p[STRENGTH] * d / p[OF_D] + p[FIRST] * v / p[OF_V]) * here


@law
def curve(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """A curve of d/D, or of v/V where p[6] is one; times v/V where p[7] is.

    p[4:6] = D, V; p[8] = how many pieces; then where they begin and the last one ends, and of each a, b, q, r of
    a + b s + q s^2/2 + r s^3/6 at the distance s from its beginning; then value and slope at the end. Beyond, a force
    is straight and a damping constant.
    """
    x = v / p[REST + 1] if p[REST + 2] > 0.0 else d / p[REST]
    damping, pieces, first = p[REST + 3] > 0.0, int(p[REST + 4]), REST + 5
    own = first + pieces + 1
    if x <= p[first]:
        f = p[own] + (0.0 if damping else p[own + 1] * (x - p[first]))
    elif x >= p[own - 1]:
        end = own + 4 * pieces
        f = p[end] + (0.0 if damping else p[end + 1] * (x - p[own - 1]))
    else:
        low, high = 0, pieces
        while high - low > 1:
            middle = (low + high) // 2
            if x < p[first + middle]:
                high = middle
            else:
                low = middle
        s, i = x - p[first + low], own + 4 * low
        f = p[i] + s * (p[i + 1] + s * (p[i + 2] / 2.0 + s * p[i + 3] / 6.0))
    return force + (f * v / p[REST + 1] if damping else f)
