"""Sessions with a force that no mechanism lists, integrated by SciPy: two masses, the tap, the recorder's filter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim_backend.pulses import Pulse
from sim_backend.recorder import analog_filter
from sim_backend.two_mass import TwoMass
from tests.analysis.ring_downs import FILTER, ONSET_S, RATE_HZ, SAMPLES, Record

Force = Callable[[float, float, float], float]
"""Deformation (m), its rate (m/s), load (N) to a force (N) that pushes back."""


def in_contact(force: Force) -> Record:
    """Return what records a tap with a further force between the masses."""
    return _recorded(force, lambda x, v: (x[0] - x[1], v[0] - v[1]), np.array([1.0, -1.0]))


def at_upper_mass(force: Force) -> Record:
    """Return what records a tap with a further force between the upper mass and the ground."""
    return _recorded(force, lambda x, v: (x[0], v[0]), np.array([1.0, 0.0]))


def _recorded(force: Force, moved: Callable[..., tuple[float, float]], direction: NDArray[np.float64]) -> Record:
    chain = analog_filter(FILTER)
    order = chain.b.size

    def record(rig: TwoMass, load_n: float, pulse: Pulse) -> NDArray[np.float64]:
        mass = np.array([rig.m1, rig.m2])
        stiffness = np.array([[rig.k1 + rig.kc, -rig.kc], [-rig.kc, rig.k2 + rig.kc]])
        damping = np.array([[rig.cc, -rig.cc], [-rig.cc, rig.cc]])

        def slope(t: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
            x, v, z = y[:2], y[2:4], y[4:]
            total = -stiffness @ x - damping @ v - direction * force(*moved(x, v), load_n)
            total[0] += float(pulse(t))
            a = total / mass
            return np.concatenate([v, a, chain.a @ z + chain.b * a[1]])

        def shown(t: float, y: NDArray[np.float64]) -> float:
            return float(chain.c[0] @ y[4:] + chain.d[0] * slope(t, y)[3])

        out = np.zeros(SAMPLES)
        at = np.arange(SAMPLES) / RATE_HZ - ONSET_S
        after, y0, begun = at[at > 0], np.zeros(4 + order), 0.0
        for end in (*pulse.knots[1:], float(after[-1])):  # the force's slope jumps there
            here = after[(after > begun) & (after <= end)]
            tolerance = np.concatenate([[1e-15, 1e-15, 1e-11, 1e-11], np.full(order, 1e-8)])
            found = solve_ivp(
                slope, (begun, end), y0, "DOP853", np.union1d(here, end), rtol=1e-8, atol=tolerance, max_step=5e-5
            )
            for t, y in zip(here, found.y.T, strict=False):
                out[np.searchsorted(at, t)] = shown(t, y)
            y0, begun = found.y[:, -1], end
        return np.stack([out, out])

    return record
