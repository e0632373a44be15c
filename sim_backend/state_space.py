"""Linear systems with one input, and their exact response to a force pulse at sampled times."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numba import njit
from scipy.linalg import matrix_balance

from sim_backend.arrays import Complex, Real
from sim_backend.propagate.exact_step import phi_functions
from sim_backend.pulses import COS, LINEAR, OFFSET, OMEGA, SIN, START, Pulse

GENERATOR = 4  # states of a pulse segment: 1, tau, sin, cos
SMALL = 1e-9  # |Im s| over |s| below which a pole counts as real


@dataclass(frozen=True, slots=True)
class StateSpace:
    """y' = a y + b u, outputs = c y + d u.

    Attributes
    ----------
    a, b, c, d
        Shapes (n, n), (n,), (outputs, n), (outputs,).
    """

    a: Real
    b: Real
    c: Real
    d: Real

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

    def fractions(self) -> tuple[Complex, Complex]:
        """Return poles, 1/s, one of each conjugate pair, and residues of the first output, (p,) each."""
        return _fractions(self.a.tobytes(), self.b.tobytes(), self.c[0].tobytes())


@lru_cache(maxsize=8)
def _fractions(*system: bytes) -> tuple[Complex, Complex]:
    a, b, c = (np.frombuffer(numbers) for numbers in system)
    s, right = np.linalg.eig(a.reshape(b.size, b.size))
    residues = (c @ right) * (np.linalg.inv(right) @ b)
    kept = s.imag >= -SMALL * np.abs(s)
    return np.where(pairs(s) == 2.0, s, s.real + 0j)[kept], residues[kept]


def pairs(poles: Complex) -> Real:
    """Return 2 for each pole that stands for a conjugate pair, 1 for each real one."""
    return np.where(np.abs(poles.imag) > SMALL * np.abs(poles), 2.0, 1.0)


def exact_response(system: StateSpace, pulse: Pulse, onset_s: float, samples: int, sample_rate_hz: float) -> Real:
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
            z = _exponential(joined * (n * dt - left)) @ z
            rows, z = _march(_exponential(joined * dt), z, stop - n, np.pad(c, ((0, 0), (0, len(start)))))
            outputs[:, n:stop] = rows
            at, n = (stop - 1) * dt, stop
        state = (_exponential(joined * (right - at)) @ z)[: len(b)]
    if n < samples:
        state = _exponential(a * (n * dt - knots[-1])) @ state
        outputs[:, n:] = _march(_exponential(a * dt), state, samples - n, c)[0]
    if np.any(system.d):
        outputs += np.outer(system.d, pulse(np.arange(samples) * dt - onset_s))
    return outputs


def _join(a: Real, b: Real, pulse: Pulse, middle: float, left: float) -> tuple[Real, Real]:
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


def _exponential(a: Real) -> Real:
    """Return exp(a), (n, n)."""
    return np.asarray(phi_functions(np.ascontiguousarray(a), 1)[0, 0], np.float64)


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
