"""The linear rig as the data see it: poles, what each mode shows in each channel, response to a force.

For the free modes ``x(t) = sum_j 2 Re(shape_j b_j exp(s_j t))``, and channel c holds
``sum_j 2 Re(gain_cj b_j exp(s_j t))``; the gain contains the sensor, the declared filter and the whitening.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.mismatch.ring_downs.noise import NoiseModel
from sim_backend.arrangement import DERIVATIVES, Arrangement
from sim_backend.arrays import Complex, Real, Whole
from sim_backend.state_space import SMALL, StateSpace, pairs


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
        (p,) what a unit impulse on the tapped body gives each mode.
    gains, filtered, raw_gains
        (c, p) what each channel shows of each mode: whitened, after the filter alone, before it.
    direct
        (c, n) acceleration in each channel at once for unit forces on the bodies.
    weight
        (p,) 2 for a conjugate pair, 1 for a real pole.
    """

    poles: Complex
    shapes: Complex
    left: Complex
    drive: Complex
    gains: Complex
    raw_gains: Complex
    filtered: Complex
    direct: Real
    weight: Real


def linear_rig(
    arrangement: Arrangement,
    values: Mapping[str, float],
    analog: StateSpace,
    noise: Sequence[NoiseModel],
    sample_rate_hz: float,
) -> LinearRig:
    """Solve the eigenvalue problem of the rig with these constants; see `linear_rigs`."""
    stacked = {name: np.array([value]) for name, value in values.items()}
    return linear_rigs(arrangement, stacked, analog, noise, sample_rate_hz)[0]


def linear_rigs(
    arrangement: Arrangement,
    values: Mapping[str, Real],
    analog: StateSpace,
    noise: Sequence[NoiseModel],
    sample_rate_hz: float,
) -> list[LinearRig]:
    """Solve the eigenvalue problems of a rig with k sets of constants, (k,) of each.

    Shapes are scaled so that the first sensor that sees a mode well shows 1 before filter and whitening.
    """
    mass, damping, stiffness = arrangement.matrices(values)
    k, n = mass.shape
    a = np.zeros((k, 2 * n, 2 * n))
    a[:, n:, :n], a[:, n:, n:] = -stiffness / mass[:, :, None], -damping / mass[:, :, None]
    # displacements in units that make them as large as velocities: a well-scaled matrix
    scale = np.sqrt(-np.trace(a[:, n:, :n], axis1=1, axis2=2) / n)[:, None, None]
    a[:, :n, n:] = np.eye(n) * scale
    a[:, n:, :n] /= scale
    s, right = np.linalg.eig(a)
    inverse = np.linalg.inv(right)
    kept = s.imag > -SMALL * np.abs(s)
    order = np.argsort(np.where(kept, np.abs(s), np.inf), axis=1)
    counts = kept.sum(axis=1)
    found: list[LinearRig | None] = [None] * k
    for count in np.unique(counts):  # nearly always all have as many
        at = np.flatnonzero(counts == count)
        modes = order[at, :count]
        poles: Complex = np.take_along_axis(s[at], modes, axis=1)
        shapes = np.take_along_axis(right[at, :n], modes[:, None], axis=2) / scale[at]
        left = np.take_along_axis(inverse[at, :, n:], modes[:, :, None], axis=1).swapaxes(1, 2) / mass[at, :, None]
        seen = [arrangement.vector(q.row, values)[at] for q in arrangement.sensors]
        rows: Complex = _shown(arrangement, values, at, poles, shapes)
        # always the same sensor where two see a mode alike: gains stay smooth functions of the constants
        clear = np.argmax(np.abs(rows) >= 0.5 * np.abs(rows).max(axis=1, keepdims=True), axis=1)
        best = np.take_along_axis(rows, clear[:, None], axis=1)
        shapes, rows = shapes / best, rows / best
        inputs: Complex = left * best
        filtered = rows * transfer(analog, poles)[:, None]
        gains = np.stack([filtered[:, c] * m.gain(poles, sample_rate_hz) for c, m in enumerate(noise)], axis=1)
        direct = np.stack(
            [
                v / mass[at] if q.quantity == "acceleration" else np.zeros((at.size, n))
                for v, q in zip(seen, arrangement.sensors, strict=True)
            ],
            axis=1,
        )
        tapped = inputs[:, arrangement.bodies.index(arrangement.tapped)]
        weight = pairs(poles)
        for i, rig in enumerate(at):
            found[rig] = LinearRig(
                poles[i], shapes[i], inputs[i], tapped[i], gains[i], rows[i], filtered[i], direct[i], weight[i]
            )
    return found  # type: ignore[return-value]


def _shown(arrangement: Arrangement, values: Mapping[str, Real], at: Whole, poles: Complex, shapes: Complex) -> Complex:
    """What the sensors (k, c, modes) show of modes: of motion, and of the strain of what they sit on."""
    found = []
    for q in arrangement.sensors:
        stretched, sheared = (part[at] for part in arrangement.strain(q, values))
        row = arrangement.vector(q.row, values)[at]
        moved = (row[:, None] @ shapes)[:, 0] * poles ** DERIVATIVES[q.quantity]
        found.append(moved + (stretched[:, None] @ shapes)[:, 0] + (sheared[:, None] @ shapes)[:, 0] * poles)
    return np.asarray(np.stack(found, axis=1), np.complex128)


def transfer(system: StateSpace, s: Complex) -> Complex:
    """Return the transfer function of a one-input one-output system at each s."""
    n = len(system.b)
    if n == 0:
        return np.full(s.shape, system.d[0], np.complex128)
    away = s[..., None, None] * np.eye(n) - system.a
    state = np.linalg.solve(away, system.b[:, None].astype(np.complex128))[..., 0]
    return np.asarray(state @ system.c[0] + system.d[0])
