"""What a force in an element does to the recorded channels, at one load: modes and declared filter taken together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.mismatch.ring_downs.linear import LinearRig, transfer
from analysis.mismatch.ring_downs.noise import NoiseModel
from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Complex, Real
from sim_backend.modal_response import parabolas, respond, step_weights
from sim_backend.state_space import StateSpace, pairs


@dataclass(frozen=True, slots=True)
class Response:
    """Response of the channels to extra forces, and the motion of the elements for modal amplitudes.

    Attributes
    ----------
    seen, rate, drive
        (elements, p): deformation and its rate for each modal amplitude, and what a unit extra force does to them.
    poles, weight
        (p + q,) of the rig and of the filter.
    residues, direct
        (elements, c, p + q) and (elements, c): channels' response to a force in an element.
    """

    rig: LinearRig
    seen: Complex
    rate: Complex
    drive: Complex
    poles: Complex
    weight: Real
    residues: Complex
    direct: Real

    def motion(self, amplitudes: Complex, element: int, t: Real) -> tuple[Real, Real]:
        """Return deformation (m) and its rate (m/s) of an element at the times t, both (n,)."""
        shown = np.exp(np.outer(t, self.rig.poles)) * (self.rig.weight * amplitudes)
        return (shown @ self.seen[element]).real.copy(), (shown @ self.rate[element]).real.copy()

    def to(self, element: int, force: Real, h: float, substeps: int) -> Real:
        """Return (c, n) the channels' response from rest to an extra force of an element at every substep."""
        forces = force[None, None]
        return responses([self], [element], h, substeps)(forces, parabolas(forces))[0]


def responses(to: Sequence[Response], elements: Sequence[int], h: float, substeps: int) -> Callable[[Real, Real], Real]:
    """Return what turns forces (runs, elements, n) at every substep and their bends into responses (runs, c, n)."""
    weights = step_weights(np.stack([one.poles for one in to]), h)
    residues = np.stack([one.residues[elements] for one in to])
    direct = np.stack([one.direct[elements] for one in to])
    weight = to[0].weight
    return lambda forces, bends: np.asarray(respond(forces, bends, weights, residues, weight, direct, substeps))


def response(arrangement: Arrangement, values: Mapping[str, float], rig: LinearRig, analog: StateSpace) -> Response:
    """Join the modes of the rig with the filter by partial fractions."""
    rows = np.array([arrangement.vector(e.row, values) for e in arrangement.elements])
    seen = rows @ rig.shapes
    drive = -(rows @ rig.left)  # a positive force in an element pushes its first body back
    filter_poles, filter_residues = analog.fractions()
    own = transfer(analog, rig.poles)
    residues = np.empty((len(rows), len(rig.gains), len(rig.poles) + len(filter_poles)), np.complex128)
    through = -(rows @ rig.direct.T)
    parts = drive[:, None] * rig.raw_gains
    residues[:, :, : len(rig.poles)] = parts * own
    residues[:, :, len(rig.poles) :] = filter_residues * (_value(parts, rig, filter_poles) + through[:, :, None])
    direct = through * (analog.d[0] if len(analog.d) else 1.0)
    # what of the drive the modes themselves have taken up is in `drive`; the channels' response starts from unit forces
    weight = np.concatenate([rig.weight, pairs(filter_poles)])
    poles = np.concatenate([rig.poles, filter_poles])
    return Response(rig, seen, seen * rig.poles, drive, poles, weight, residues, direct)


def _value(parts: Complex, rig: LinearRig, s: Complex) -> Complex:
    """Transfer functions (..., k) of the rig at each s (k,) from their residues (..., p)."""
    pairs = rig.weight == 2.0
    own, mirrored = 1 / (s - rig.poles[:, None]), 1 / (s - np.conj(rig.poles[pairs, None]))
    return np.asarray(parts @ own + np.conj(parts[..., pairs]) @ mirrored)


def whiten(y: Real, noise: Sequence[NoiseModel]) -> Real:
    """Whiten (..., c, n) that was zero before its first sample."""
    return np.stack([m.whiten(y[..., c, :]) for c, m in enumerate(noise)], axis=-2)
