"""The linear rig as the data see it: poles, what each mode shows in each channel, response to a force.

For the free modes ``x(t) = sum_j 2 Re(shape_j b_j exp(s_j t))``, and channel c holds
``sum_j 2 Re(gain_cj b_j exp(s_j t))``; the gain contains the sensor, the declared filter and the whitening.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.colour import Colour
from sim_backend.arrangement import Arrangement
from sim_backend.state_space import StateSpace

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}
SMALL = 1e-9  # |Im s| over |s| below which a pole counts as real


@dataclass(frozen=True, slots=True)
class LinearRig:
    """Modes of a linear rig.

    Attributes
    ----------
    poles
        (p,) 1/s: one of each conjugate pair (positive imaginary part), and the real ones.
    shapes
        (n, p) displacement of each body.
    left
        (n, p) ``left.T @ force`` drives the modes: ``b' = s b + left.T f``.
    drive
        (p,) what a unit impulse on the struck body gives each mode.
    gains, filtered, raw_gains
        (c, p) what each channel shows of each mode: whitened, after the filter alone, before it.
    direct
        (c, n) acceleration in each channel at once for unit forces on the bodies.
    """

    poles: Complex
    shapes: Complex
    left: Complex
    drive: Complex
    gains: Complex
    raw_gains: Complex
    filtered: Complex
    direct: Real

    @property
    def weight(self) -> Real:
        """(p,) 2 for a conjugate pair, 1 for a real pole."""
        return np.where(np.abs(self.poles.imag) > SMALL * np.abs(self.poles), 2.0, 1.0)


def linear_rig(
    arrangement: Arrangement,
    values: Mapping[str, float],
    analog: StateSpace,
    noise: Sequence[Colour],
    sample_rate_hz: float,
) -> LinearRig:
    """Solve the eigenvalue problem of the rig with these constants.

    Shapes are scaled so that the first sensor that sees a mode well shows 1 before filter and whitening.
    """
    mass, damping, stiffness = arrangement.matrices(values)
    n = len(mass)
    a = np.zeros((2 * n, 2 * n))
    a[:n, n:] = np.eye(n)
    a[n:, :n], a[n:, n:] = -stiffness / mass[:, None], -damping / mass[:, None]
    # displacements in units that make them as large as velocities: a well-scaled matrix
    scale = np.sqrt(np.trace(stiffness / mass[:, None]) / n)
    a[:n, n:] *= scale
    a[n:, :n] /= scale
    s, right = np.linalg.eig(a)
    inverse = np.linalg.inv(right)
    kept = np.flatnonzero(s.imag > -SMALL * np.abs(s))
    kept = kept[np.argsort(np.abs(s[kept]))]
    poles, shapes = s[kept], right[:n, kept] / scale
    left = inverse[kept][:, n:].T / mass[:, None]
    seen = [arrangement.vector(q.row, values) for q in arrangement.sensors]
    rows = np.array(
        [(v @ shapes) * poles ** DERIVATIVES[q.quantity] for v, q in zip(seen, arrangement.sensors, strict=True)]
    )
    # always the same sensor where two see a mode alike: gains stay smooth functions of the constants
    clear = np.argmax(np.abs(rows) >= 0.5 * np.abs(rows).max(axis=0), axis=0)
    best = rows[clear, np.arange(len(poles))]
    shapes, left, rows = shapes / best, left * best, rows / best
    filtered = rows * transfer(analog, poles)
    gains = np.array([row * m.gain(poles, sample_rate_hz) for row, m in zip(filtered, noise, strict=True)])
    direct = np.array(
        [
            v / mass if q.quantity == "acceleration" else np.zeros(n)
            for v, q in zip(seen, arrangement.sensors, strict=True)
        ]
    )
    struck = left[arrangement.bodies.index(arrangement.struck)]
    return LinearRig(poles, shapes, left, struck, gains, rows, filtered, direct)


def transfer(system: StateSpace, s: Complex) -> Complex:
    """Return the transfer function of a one-input one-output system at each s."""
    n = len(system.b)
    if n == 0:
        return np.full(s.shape, system.d[0], np.complex128)
    identity = np.eye(n)
    return np.array([system.c[0] @ np.linalg.solve(z * identity - system.a, system.b) + system.d[0] for z in s])
