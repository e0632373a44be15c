"""Linear systems with one input, and their exact response to a force pulse at sampled times."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import matrix_balance

from sim_backend.pulses import COS, LINEAR, OFFSET, OMEGA, SIN, START, Pulse

GENERATOR = 4  # states of a pulse segment: 1, tau, sin, cos
TAYLOR_TERMS = 18  # (1/2)^19 / 19! is far below rounding


@dataclass(frozen=True, slots=True)
class StateSpace:
    """y' = a y + b u, outputs = c y + d u.

    Attributes
    ----------
    a, b, c, d
        Shapes (n, n), (n,), (outputs, n), (outputs,).
    """

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    d: NDArray[np.float64]

    def then(self, second: StateSpace) -> StateSpace:
        """Return this system with its first output sent through ``second``; the other outputs stay as they are."""
        n, m = len(self.b), len(second.b)
        a = np.zeros((n + m, n + m))
        a[:n, :n], a[n:, n:], a[n:, :n] = self.a, second.a, np.outer(second.b, self.c[0])
        c = np.zeros((len(self.d), n + m))
        c[:, :n] = self.c
        c[0, :n], c[0, n:] = second.d[0] * self.c[0], second.c[0]
        d = self.d.copy()
        d[0] *= second.d[0]
        return StateSpace(a, np.concatenate([self.b, second.b * self.d[0]]), c, d)


def exact_response(
    system: StateSpace, pulse: Pulse, onset_s: float, samples: int, sample_rate_hz: float
) -> NDArray[np.float64]:
    """Return the outputs, (outputs, samples), at the times n / sample_rate_hz, from rest.

    Every segment of the pulse solves a linear system of its own (1, tau, sin, cos); joined to ``system`` it makes
    an autonomous system, whose matrix exponential is the exact solution between knots and samples. The onset need
    not be at a sample.
    """
    _, (scale, _) = matrix_balance(system.a, permute=False, separate=True)
    a = system.a * scale / scale[:, np.newaxis]
    b, c = system.b / scale, system.c * scale

    outputs = np.zeros((len(system.d), samples))
    dt = 1 / sample_rate_hz
    state = np.zeros(len(b))
    knots = onset_s + pulse.knots
    n = int(np.clip(np.ceil(onset_s * sample_rate_hz), 0, samples))
    for left, right in pairwise(knots.tolist()):
        joined, start = _join(a, b, pulse, (left + right) / 2 - onset_s, left - onset_s)
        z = np.concatenate([state, start])
        stop = int(np.clip(np.ceil(right * sample_rate_hz), n, samples))
        at = left
        if stop > n:
            z = exponential(joined * (n * dt - left)) @ z
            rows, z = _march(exponential(joined * dt), z, stop - n, np.pad(c, ((0, 0), (0, len(start)))))
            outputs[:, n:stop] = rows
            at, n = (stop - 1) * dt, stop
        state = (exponential(joined * (right - at)) @ z)[: len(b)]
    if n < samples:
        state = exponential(a * (n * dt - knots[-1])) @ state
        outputs[:, n:] = _march(exponential(a * dt), state, samples - n, c)[0]
    if np.any(system.d):
        outputs += np.outer(system.d, pulse(np.arange(samples) * dt - onset_s))
    return outputs


def _join(
    a: NDArray[np.float64], b: NDArray[np.float64], pulse: Pulse, middle: float, left: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the matrix of system and active segments together, and the segments' states at ``left``."""
    active = pulse.active(middle)
    n, m = len(b), GENERATOR * len(active)
    joined = np.zeros((n + m, n + m))
    joined[:n, :n] = a
    start = np.empty(m)
    for i, s in enumerate(pulse.segments[active]):
        at, here = n + GENERATOR * i, GENERATOR * i
        joined[:n, at : at + GENERATOR] = np.outer(b, [s[OFFSET], s[LINEAR], s[SIN], s[COS]])
        joined[at + 1, at] = 1.0
        joined[at + 2, at + 3], joined[at + 3, at + 2] = s[OMEGA], -s[OMEGA]
        tau = left - s[START]
        start[here : here + GENERATOR] = 1.0, tau, np.sin(s[OMEGA] * tau), np.cos(s[OMEGA] * tau)
    return joined, start


@njit(cache=True)
def exponential(a):  # type: ignore[no-untyped-def]
    """Return exp(a) of a balanced (n, n) matrix: Taylor series of a / 2^s, s with a norm below 1/2, squared s times.

    Plain loops, here and in `_march`: a linear-algebra library would spread such small matrices over threads, which
    takes longer and may round differently from machine to machine.
    """
    n = len(a)
    norm = 0.0
    for j in range(n):
        norm = max(norm, np.sum(np.abs(a[:, j])))
    squarings = max(0, math.ceil(math.log2(norm)) + 1) if norm > 0.0 else 0
    small = a / 2.0**squarings
    result = np.eye(n)
    for term in range(TAYLOR_TERMS, 0, -1):
        result = _product(small, result) / term
        for i in range(n):
            result[i, i] += 1.0
    for _ in range(squarings):
        result = _product(result, result)
    return result


@njit(cache=True)
def _product(a, b):  # type: ignore[no-untyped-def]
    n = len(a)
    c = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            if a[i, k] != 0.0:
                for j in range(n):
                    c[i, j] += a[i, k] * b[k, j]
    return c


@njit(cache=True)
def _march(step, state, count, c):  # type: ignore[no-untyped-def]
    """Return outputs (outputs, count) of ``state``, step @ state, ..., and the last of these states."""
    n = len(state)
    outputs = np.empty((len(c), count))
    now, following = state.copy(), np.empty(n)
    for j in range(count):
        if j > 0:
            for i in range(n):
                total = 0.0
                for k in range(n):
                    total += step[i, k] * now[k]
                following[i] = total
            now, following = following, now
        for i in range(len(c)):
            total = 0.0
            for k in range(n):
                total += c[i, k] * now[k]
            outputs[i, j] = total
    return outputs, now
