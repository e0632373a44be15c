"""Integration of x' = A x + B u + forces of laws: Runge and Kutta's fourth order on the exact linear solution.

The integrating factor (Lawson, 1967) makes the linear part exact, so that its error is that of the laws' small forces
and of Simpson's rule for the input. A step in which a law has a jump is broken off there and gone on with in plain
steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import expm

from mesotap.proof.rigs.laws import FRICTION, REID, SLIP, force, side, slide

Array = NDArray[np.float64]
HALVINGS = 45  # of a step, to find a jump
PIECES = 30  # of a step at most


class Machine(NamedTuple):
    """What is integrated: n states, m laws.

    ``a`` (n, n) and ``b`` (n,): linear part; ``half`` and ``whole``: its solution over half a step and a step of length
    ``h``. ``deformation``, ``rate`` and ``push`` (m, n): of each law, from the state, and what its force does to x'.
    ``codes`` (m,), ``constants`` (m, 4), ``memory`` (m, 3, SLIDERS).
    """

    a: Array
    b: Array
    half: Array
    whole: Array
    h: float
    deformation: Array
    rate: Array
    push: Array
    codes: NDArray[np.int64]
    constants: Array
    memory: Array


class Kick(NamedTuple):
    """A jump of the state before a step."""

    step: int
    jump: Array


def solved(a: Array, h: float) -> tuple[Array, Array]:
    """Return exp(a h / 2) and exp(a h)."""
    half = np.ascontiguousarray(expm(a * (h / 2)))
    return half, np.ascontiguousarray(half @ half)


@njit(cache=True)
def _forces(x: Array, u: float, t: float, m: Machine, modes: Array) -> Array:
    """B u and what the laws add to x'; stuck friction is whatever keeps its rate."""
    out = m.b * u
    stuck = -1
    for i in range(m.codes.size):
        if m.codes[i] == FRICTION and modes[i] == 0:
            stuck = i
            continue
        d, v = np.dot(m.deformation[i], x), np.dot(m.rate[i], x)
        out += m.push[i] * force(m.codes[i], d, v, t, modes[i], m.constants[i], m.memory[i])
    if stuck >= 0:
        out -= m.push[stuck] * (_needed(x, out, m, stuck))
    return out


@njit(cache=True)
def _needed(x: Array, others: Array, m: Machine, i: int) -> float:
    """Return minus the friction that keeps the rate of law ``i`` under the other forces."""
    return np.dot(m.rate[i], m.a @ x + others) / np.dot(m.rate[i], m.push[i])


@njit(cache=True)
def _event(x: Array, u: float, t: float, m: Machine, modes: Array, i: int) -> float:
    """Negative once law ``i`` has passed its jump."""
    if m.codes[i] == FRICTION and modes[i] == 0:
        free = m.b * u
        for j in range(m.codes.size):
            if j != i:
                d, v = np.dot(m.deformation[j], x), np.dot(m.rate[j], x)
                free += m.push[j] * force(m.codes[j], d, v, t, modes[j], m.constants[j], m.memory[j])
        return m.constants[i, 0] - abs(_needed(x, free, m, i))
    d, v = np.dot(m.deformation[i], x), np.dot(m.rate[i], x)
    return modes[i] * side(m.codes[i], d, v, m.constants[i])


@njit(cache=True)
def _lawson(x: Array, u: Array, t: float, m: Machine, modes: Array) -> Array:
    h = m.h
    k1 = _forces(x, u[0], t, m, modes)
    middle = m.half @ x
    k2 = _forces(middle + m.half @ k1 * (h / 2), u[1], t + h / 2, m, modes)
    k3 = _forces(middle + k2 * (h / 2), u[1], t + h / 2, m, modes)
    end = m.half @ middle
    k4 = _forces(end + m.half @ k3 * h, u[2], t + h, m, modes)
    return end + (m.whole @ k1 + m.half @ (k2 + k3) * 2.0 + k4) * (h / 6)


@njit(cache=True)
def _between(u: Array, s: float) -> float:
    """Parabola through the input at the beginning, middle and end of a step."""
    return u[0] * (1 - s) * (1 - 2 * s) + 4 * u[1] * s * (1 - s) + u[2] * s * (2 * s - 1)


@njit(cache=True)
def _plain(x: Array, u: Array, span: Array, m: Machine, modes: Array) -> Array:
    """Runge and Kutta's step of the whole equation; ``span``: time at the step's beginning, from, length."""
    t, from_, tau = span[0], span[1], span[2]
    u0, u1, u2 = _between(u, from_ / m.h), _between(u, (from_ + tau / 2) / m.h), _between(u, (from_ + tau) / m.h)
    begin = t + from_
    k1 = m.a @ x + _forces(x, u0, begin, m, modes)
    y = x + k1 * (tau / 2)
    k2 = m.a @ y + _forces(y, u1, begin + tau / 2, m, modes)
    y = x + k2 * (tau / 2)
    k3 = m.a @ y + _forces(y, u1, begin + tau / 2, m, modes)
    y = x + k3 * tau
    k4 = m.a @ y + _forces(y, u2, begin + tau, m, modes)
    return x + (k1 + 2 * k2 + 2 * k3 + k4) * (tau / 6)


@njit(cache=True)
def _switch(x: Array, u: float, t: float, m: Machine, modes: Array, i: int) -> None:
    """Go over to the other side of the jump of law ``i``; friction may stick, or begin to slide where it is pushed."""
    if m.codes[i] != FRICTION:
        modes[i] = -modes[i]
        return
    was = modes[i]
    modes[i] = 0.0
    if _event(x, u, t, m, modes, i) > 0:
        _hold(x, m, i)
        return
    others = np.zeros(x.size)
    if was == 0:
        modes[i] = 1.0
        pushed = _forces(x, u, t, m, modes)
        others += pushed - m.push[i] * m.constants[i, 0]
        modes[i] = 1.0 if np.dot(m.rate[i], m.a @ x + others) > 0 else -1.0
    else:
        modes[i] = -was


@njit(cache=True)
def _hold(x: Array, m: Machine, i: int) -> None:
    """Take the rate of a stuck law, which is zero but for rounding, out of the state."""
    x -= m.push[i] * (np.dot(m.rate[i], x) / np.dot(m.rate[i], m.push[i]))


@njit(cache=True)
def _remember(x: Array, m: Machine) -> None:
    for i in range(m.codes.size):
        if m.codes[i] == SLIP:
            d = np.dot(m.deformation[i], x)
            slide(m.memory[i, 1], m.memory[i, 0], d - m.memory[i, 2, 0])
            m.memory[i, 2, 0] = d


@njit(cache=True)
def _broken(x: Array, u: Array, t: float, m: Machine, modes: Array, i: int) -> Array:
    """Take one step in pieces between the jumps of law ``i``."""
    done = 0.0
    for piece in range(PIECES):
        left = m.h - done
        y = _plain(x, u, np.array([t, done, left]), m, modes)
        if piece == PIECES - 1 or _event(y, u[2], t + m.h, m, modes, i) >= 0:
            return y
        low, high = 0.0, left
        for _ in range(HALVINGS):
            tau = 0.5 * (low + high)
            y = _plain(x, u, np.array([t, done, tau]), m, modes)
            if _event(y, _between(u, (done + tau) / m.h), t + done + tau, m, modes, i) < 0:
                high = tau
            else:
                low = tau
        x = _plain(x, u, np.array([t, done, high]), m, modes)
        done += high
        _remember(x, m)
        _switch(x, _between(u, done / m.h), t + done, m, modes, i)
    return x


@njit(cache=True)
def _begin(x: Array, u: float, m: Machine, modes: Array) -> None:
    for i in range(m.codes.size):
        d, v = np.dot(m.deformation[i], x), np.dot(m.rate[i], x)
        modes[i] = 1.0 if side(m.codes[i], d, v, m.constants[i]) >= 0 else -1.0
        moving = m.codes[i] == FRICTION or m.codes[i] == SLIP or m.codes[i] == REID
        if moving and v == 0:
            if m.codes[i] == FRICTION:
                _switch(x, u, 0.0, m, modes, i)
            else:
                modes[i] = 1.0 if np.dot(m.rate[i], m.a @ x + m.b * u) > 0 else -1.0


@njit(cache=True)
def integrate(m: Machine, x: Array, u: Array, kick: Kick, jumping: int) -> tuple[Array, Array]:
    """Return states and their rates at the beginning and after every step, shapes (steps + 1, n).

    ``u`` (steps, 3) is the input at the beginning, middle and end of each; ``jumping`` the law with a jump, or -1.
    """
    steps = u.shape[0]
    states, rates = np.empty((steps + 1, x.size)), np.empty((steps + 1, x.size))
    modes = np.ones(m.codes.size)
    x = x.copy()
    _remember(x, m)
    _begin(x, u[0, 0], m, modes)
    for k in range(steps):
        if k == kick.step:
            x += kick.jump
        states[k] = x
        rates[k] = m.a @ x + _forces(x, u[k, 0], k * m.h, m, modes)
        y = _lawson(x, u[k], k * m.h, m, modes)
        if jumping >= 0 and _event(y, u[k, 2], (k + 1) * m.h, m, modes, jumping) < 0:
            y = _broken(x, u[k], k * m.h, m, modes, jumping)
        if jumping >= 0 and m.codes[jumping] == FRICTION and modes[jumping] == 0:
            _hold(y, m, jumping)
        _remember(y, m)
        x = y
    states[steps] = x
    rates[steps] = m.a @ x + _forces(x, u[steps - 1, 2], steps * m.h, m, modes)
    return states, rates


@njit(cache=True)
def propagate(m: Machine, x: Array, u: Array, kick: Kick) -> Array:
    """Return the states of the linear part alone: as `integrate` without laws, at less expense."""
    steps, n = u.shape[0], x.size
    states = np.empty((steps + 1, n))
    first, middle, last = m.whole @ m.b * (m.h / 6), m.half @ m.b * (4 * m.h / 6), m.b * (m.h / 6)
    states[0] = x
    for k in range(steps):
        if k == kick.step:
            states[k] += kick.jump
        for i in range(n):
            total = first[i] * u[k, 0] + middle[i] * u[k, 1] + last[i] * u[k, 2]
            for j in range(n):
                total += m.whole[i, j] * states[k, j]
            states[k + 1, i] = total
    return states
