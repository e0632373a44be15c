"""Tube springs whose walls ring: a thin ring between two lines, its motion a sum of shapes that keep its length.

The wall moves by w = sum a_n cos(n t) outwards and v = - sum a_n sin(n t) / n along, n = 1, 2, ..., t the angle from
the line on the ground. Of a ring of unit mass and unit E I / R^3 kinetic and potential energy are those of

    M = diag((1 + 1 / n^2) / 2),    K = pi diag((n^2 - 1)^2).

On the ground sum a_n = 0; the block moves by x = - sum (-1)^n a_n. With the block held, the shapes that are left have
modes; that of lowest frequency is driven by the block's acceleration through what it has of the static shape, and pulls
back like its effective mass on a spring (Craig and Bampton 1968). The others are far above what is recorded. A ring of
stiffness k and mass m has that mode at ``RATIO sqrt(k / m)`` with ``SHARE m``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.linalg import eigh, null_space

from mesotap.proof.generator.effect import Character, with_body
from mesotap.proof.generator.integration import Machine
from mesotap.proof.generator.plan import Plan

SHAPES = 120


def ringing(shapes: int = SHAPES) -> tuple[float, float]:
    """Angular frequency over sqrt(k / m), and effective over whole mass, of a ring's first mode with the block held."""
    n = np.arange(1.0, shapes + 1)
    mass, stiffness = (1 + 1 / n**2) / 2, math.pi * (n**2 - 1) ** 2
    ground, block = np.ones(shapes), -((-1.0) ** n)
    lines = np.array([ground, block])
    # under the force that moves the block by 1, the ring on the ground: stiffness a + lines^T forces = 0
    saddle = np.block([[np.diag(stiffness), lines.T], [lines, np.zeros((2, 2))]])
    static = np.linalg.solve(saddle, np.concatenate([np.zeros(shapes), [0.0, 1.0]]))
    still = static[:shapes]
    free = null_space(lines)
    squares, modes = eigh(free.T * stiffness @ free, free.T * mass @ free, subset_by_index=[0, 3])
    taken = (modes.T @ free.T @ (mass * still)) ** 2  # the modes have unit mass
    first = int(np.flatnonzero(taken > 1e-6)[0])
    return math.sqrt(squares[first] / -static[-1]), float(taken[first])


RATIO, SHARE = ringing()


def walls_ring(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """Tubes of s kg in the mean, cut from one: stiffness and mass go with their lengths, and their frequency is one.

    The plan's masses hold what of the tubes moves with the blocks at rest.
    """
    mean = float(np.mean(plan.springs))
    angular = RATIO * math.sqrt(mean / s)
    for i, k in enumerate(plan.springs):
        mass = SHARE * s * k / mean
        direction = np.zeros(machine.mass.size + 1)
        direction[i], direction[-1] = -1.0, 1.0
        machine = with_body(machine, mass, direction, mass * angular**2, 2 * c["zeta"] * mass * angular)
        machine.mass[i] -= mass
    return machine


def tell_walls(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    """Return the parameters of the mean tube."""
    angular, mass = RATIO * math.sqrt(float(np.mean(plan.springs)) / s), SHARE * s
    return {
        "tube_kg": s,
        "tube_mode_mass_kg": mass,
        "tube_mode_stiffness_n_per_m": mass * angular**2,
        "tube_mode_damping_n_s_per_m": 2 * c["zeta"] * mass * angular,
    }
