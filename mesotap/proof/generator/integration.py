"""Newton's equations of a few bodies after taps, by the classical Runge-Kutta method in small equal steps.

Compiled anew in every process: a compiled integrator kept on disk would not notice that a law in `laws` has changed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesotap.proof.generator.laws import MEMORY, push, remember, remembers

Real = NDArray[np.float64]
Whole = NDArray[np.int64]

STEPS_PER_SAMPLE = 16
"""Steps in a sample of the recorder: 2.5 us at 25 kHz, 100 steps in a period of 4 kHz."""


@dataclass(frozen=True, slots=True)
class Acting:
    """A force law in a link: ``direction`` (b,) turns positions into the link's deformation.

    ``numbers`` (n, k) are the law's own numbers ``p`` for each impact.
    """

    law: int
    direction: Real
    numbers: Real


@dataclass(frozen=True, slots=True)
class Machine:
    """Bodies between linear springs and dampers, the force laws that act besides them, and the force pulses on body 0.

    Attributes
    ----------
    mass
        (b,) kg.
    stiffness, damping
        (n, b, b) N/m and N s/m for each of n impacts.
    contact
        (b,) direction of the contact link: its deformation is ``contact @ x``.
    contact_line
        (n, 2) stiffness and damping of the contact that the matrices hold.
    seen
        (c, b) accelerations of the bodies to what each channel sees.
    pulses
        (n, k, 5) of each impact: start (s), duration (s), peak (N), and two exponents of the shape, see `pulse`.
    acting
        The laws, in the order in which they act.
    placed
        (c, b) places of the bodies, m, to what each channel sees besides, m/s2; None where it sees none.
    thrown
        (n, b) rates of the bodies at the start of each impact, m/s; None where all are at rest.
    """

    mass: Real
    stiffness: Real
    damping: Real
    contact: Real
    contact_line: Real
    seen: Real
    pulses: Real
    acting: tuple[Acting, ...] = field(default=())
    placed: Real | None = None
    thrown: Real | None = None


def integrate(machine: Machine, steps: int, step_s: float) -> Real:
    """Return what the channels see, (n, c, steps) m/s2, from the start of the first pulse."""
    count = machine.stiffness.shape[0]
    bodies = machine.mass.size
    acting = machine.acting
    widest = max((a.numbers.shape[1] for a in acting), default=1)
    laws = np.array([a.law for a in acting], dtype=np.int64)
    directions = np.zeros((len(acting), bodies))
    numbers = np.zeros((count, len(acting), widest))
    for j, a in enumerate(acting):
        directions[j] = a.direction
        numbers[:, j, : a.numbers.shape[1]] = a.numbers
    out = np.empty((count, machine.seen.shape[0], steps))
    _integrate(
        machine.mass,
        machine.stiffness,
        machine.damping,
        machine.contact,
        machine.contact_line,
        machine.seen,
        _padded(machine),
        np.zeros((count, bodies)) if machine.thrown is None else machine.thrown,
        machine.pulses,
        laws,
        directions,
        numbers,
        step_s,
        out,
    )
    return out


def _padded(machine: Machine) -> Real:
    """Return ``placed`` for all bodies, those that came later among them."""
    out = np.zeros_like(machine.seen)
    if machine.placed is not None:
        out[: len(machine.placed), : machine.placed.shape[1]] = machine.placed
    return out


@njit
def pulse(t: float, shape: Real) -> float:
    """Force of a pulse, N: peak times sin(pi u^q)^p, with u the elapsed fraction of its duration."""
    u = (t - shape[0]) / shape[1]
    if u <= 0.0 or u >= 1.0:
        return 0.0
    return shape[2] * np.sin(np.pi * u ** shape[4]) ** shape[3]


@njit
def _accelerate(
    t: float, elapsed: float, x: Real, v: Real, mass: Real, stiffness: Real, damping: Real, contact: Real, line: Real,
    pulses: Real, laws: Whole, directions: Real, numbers: Real, memory: Real, held: Real, start: Real, out: Real,
) -> None:  # fmt: skip
    bodies = mass.size
    for i in range(bodies):
        force = 0.0
        for k in range(bodies):
            force -= stiffness[i, k] * x[k] + damping[i, k] * v[k]
        out[i] = force
    for b in range(pulses.shape[0]):
        out[0] += pulse(t, pulses[b])
    borne = 0.0
    for k in range(bodies):
        borne += contact[k] * (line[0] * x[k] + line[1] * v[k])
    for j in range(laws.size):
        d = 0.0
        rate = 0.0
        at_contact = True
        for k in range(bodies):
            d += directions[j, k] * x[k]
            rate += directions[j, k] * v[k]
            at_contact = at_contact and directions[j, k] == contact[k]
        if remembers(laws[j]):
            for i in range(memory.shape[1]):
                held[i] = remember(laws[j], numbers[j], i, memory[j, i], start[j], d, elapsed)
        more = push(laws[j], numbers[j], t, d, rate, held, borne)
        if at_contact:
            borne += more
        for k in range(bodies):
            out[k] -= directions[j, k] * more
    for i in range(bodies):
        out[i] /= mass[i]


@njit
def _integrate(
    mass: Real, stiffness: Real, damping: Real, contact: Real, line: Real, seen: Real, placed: Real, thrown: Real,
    pulses: Real, laws: Whole, directions: Real, numbers: Real, h: float, out: Real,
) -> None:  # fmt: skip
    bodies = mass.size
    x = np.zeros(bodies)
    v = np.zeros(bodies)
    xs = np.zeros(bodies)
    vs = np.zeros(bodies)
    a1 = np.zeros(bodies)
    a2 = np.zeros(bodies)
    a3 = np.zeros(bodies)
    a4 = np.zeros(bodies)
    memory = np.zeros((laws.size, MEMORY))
    held = np.zeros(MEMORY)
    start = np.zeros(laws.size)
    for n in range(out.shape[0]):
        x[:] = 0.0
        v[:] = thrown[n]
        memory[:] = 0.0
        start[:] = 0.0
        for s in range(out.shape[2]):
            t = s * h
            _accelerate(
                t, 0.0, x, v, mass, stiffness[n], damping[n], contact, line[n], pulses[n], laws, directions, numbers[n],
                memory, held, start, a1,
            )  # fmt: skip
            for c in range(seen.shape[0]):
                total = 0.0
                for k in range(bodies):
                    total += seen[c, k] * a1[k] + placed[c, k] * x[k]
                out[n, c, s] = total
            for k in range(bodies):
                xs[k] = x[k] + h / 2 * v[k]
                vs[k] = v[k] + h / 2 * a1[k]
            _accelerate(
                t + h / 2, h / 2, xs, vs, mass, stiffness[n], damping[n], contact, line[n], pulses[n], laws, directions,
                numbers[n], memory, held, start, a2,
            )  # fmt: skip
            for k in range(bodies):
                xs[k] = x[k] + h / 2 * v[k] + h * h / 4 * a1[k]
                vs[k] = v[k] + h / 2 * a2[k]
            _accelerate(
                t + h / 2, h / 2, xs, vs, mass, stiffness[n], damping[n], contact, line[n], pulses[n], laws, directions,
                numbers[n], memory, held, start, a3,
            )  # fmt: skip
            for k in range(bodies):
                xs[k] = x[k] + h * v[k] + h * h / 2 * a2[k]
                vs[k] = v[k] + h * a3[k]
            _accelerate(
                t + h, h, xs, vs, mass, stiffness[n], damping[n], contact, line[n], pulses[n], laws, directions,
                numbers[n], memory, held, start, a4,
            )  # fmt: skip
            for k in range(bodies):
                x[k] += h * v[k] + h * h / 6 * (a1[k] + a2[k] + a3[k])
                v[k] += h / 6 * (a1[k] + 2 * a2[k] + 2 * a3[k] + a4[k])
            for j in range(laws.size):
                d = 0.0
                for k in range(bodies):
                    d += directions[j, k] * x[k]
                if remembers(laws[j]):
                    for i in range(MEMORY):
                        memory[j, i] = remember(laws[j], numbers[n, j], i, memory[j, i], start[j], d, h)
                start[j] = d
