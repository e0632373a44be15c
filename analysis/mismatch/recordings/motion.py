"""How a described rig moves at the samples of a recording and before the first of them, and what sets it going."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm

from sim_backend.arrays import Real
from sim_backend.propagate import Division, Given

BEFORE = 32  # samples before the first that what remembers is shown
GROWTH = 10.0  # of a motion followed backwards, up to which it is: what has died out cannot be told


def _none() -> Real:
    return np.zeros(0)


@dataclass(frozen=True, slots=True)
class Own:
    """What is each recording's own.

    Attributes
    ----------
    state, tones
        The state (2n,) where fitting begins, and (channels, 2 lines) of tones.
    impact
        Time (s, from the first sample) of a second impact and how much faster (m/s) the body is that it strikes; empty
        without one.
    memory
        (channels,) what each channel remembers at the first sample of what was before, where something makes it.
    """

    state: Real
    tones: Real
    impact: Real = field(default_factory=_none)
    memory: Real = field(default_factory=_none)

    @property
    def size(self) -> int:
        """Numbers in it."""
        return self.state.size + self.tones.size + self.impact.size + self.memory.size

    def moved(self, step: Real) -> Own:
        """Return it after a step (size,)."""
        n, m = self.state.size, self.state.size + self.tones.size
        k = m + self.impact.size
        tones = self.tones + step[n:m].reshape(self.tones.shape)
        return Own(self.state + step[:n], tones, self.impact + step[m:k], self.memory + step[k:])

    def beginning(self, other: Own, struck: bool) -> Own:
        """Return it with another one's tones and memory where it has as many, and its impact where ``struck``."""
        return Own(
            self.state,
            other.tones if other.tones.shape == self.tones.shape else self.tones,
            other.impact if struck else self.impact,
            other.memory if other.memory.size == self.memory.size else self.memory,
        )


@dataclass(frozen=True, slots=True)
class Motion:
    """At the samples: states (n, 2 bodies), extra forces (n, elements), inputs' forces on the bodies (n, bodies).

    ``division`` is that of its steps, where it was asked for; see `sim_backend.propagate.Motion`.
    """

    states: Real
    extra: Real
    force: Real
    division: Division = field(default_factory=lambda: np.zeros((1, 0), np.int8))

    def begun_earlier(self, mass: Real, damping: Real, stiffness: Real, rate_hz: float) -> Motion:
        """Return a free decay with samples before its first, as the linear rig (n,), (n, n), (n, n) came there."""
        back = backwards(mass, damping, stiffness) / rate_hz
        growth = float(np.linalg.eigvals(back).real.max())
        count = BEFORE if growth * BEFORE <= math.log(GROWTH) else int(math.log(GROWTH) / growth)
        step, states = expm(back), [self.states[0]]
        for _ in range(count):
            states.append(step @ states[-1])
        still = [np.zeros((count, rows.shape[1])) for rows in (self.extra, self.force)]
        return Motion(
            np.concatenate([states[:0:-1], self.states]) if count else self.states,
            np.concatenate([still[0], self.extra]),
            np.concatenate([still[1], self.force]),
        )


def backwards(mass: Real, damping: Real, stiffness: Real) -> Real:
    """Return (2n, 2n) the slope of a free linear rig's state when time runs backwards, 1/s."""
    n = mass.size
    out = np.zeros((2 * n, 2 * n))
    out[:n, n:], out[n:, :n], out[n:, n:] = -np.eye(n), stiffness / mass[:, None], damping / mass[:, None]
    return out


def impulse(substeps: int, substep: float, size: float) -> Real:
    """Return (2, substeps) a force that is an impulse, where each substep begins and ends.

    It acts in one substep only, in which its moments of order zero and one are those of the impulse.

    Parameters
    ----------
    substep
        When, in substeps from the first; one beyond either end adds nothing.
    size
        The impulse over the length of a substep, N.

    Examples
    --------
    >>> impulse(4, 1.25, 2.0).tolist()
    [[0.0, 5.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0]]
    """
    first, out = math.floor(substep), np.zeros((2, substeps))
    if 0 <= first < substeps:
        passed = substep - first
        out[:, first] = size * (4 - 6 * passed), size * (6 * passed - 2)
    return out


def with_impulse(given: Given, substep: float, size: float) -> Given:
    """Return inputs of one run with an impulse as one more, every substep by itself; see `impulse`."""
    rows = [np.repeat(u[0], given.held, axis=1) for u in (given.start, given.end, given.bend)]
    begin, end = impulse(rows[0].shape[1], substep, size)
    start, stop, bend = (np.vstack([u, s])[None] for u, s in zip(rows, (begin, end, 0 * begin), strict=True))
    return Given(start, stop, bend, 1)


def sensible(mass: Real, damping: Real, stiffness: Real, rate: float) -> bool:
    """Whether the rig can be stepped at all: the extra forces aside, no mode faster than the sampling allows."""
    if not (np.all(np.isfinite(mass)) and np.all(mass > 0) and np.all(np.isfinite(stiffness))):
        return False
    fastest = math.sqrt(float(np.abs(stiffness / mass[:, None]).sum(axis=1).max()))
    return fastest < 40 * rate and float(np.abs(damping / mass[:, None]).sum(axis=1).max()) < 100 * rate
