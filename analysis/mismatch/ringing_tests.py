"""Tests of vibrations that a candidate adds to every segment (bodies, tones), beside its effect on the rig's modes.

Their amplitudes are free in every segment, and taken out there; what is left is summed over the segments.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.mismatch.elimination import eliminated_and_taken
from analysis.mismatch.problem import Columns, Rung
from sim_backend.arrays import Real

RINGS_ITSELF = 1e-5  # share of a wave that must be left beside what the segment does by itself
REPEATED = 1e-8  # eigenvalue of a candidate's waves' cosines below which they repeat each other


class RingingTests:
    """Sums over segments.

    Parameters
    ----------
    lines
        How many tones each candidate is whose loudness is bounded; none of others.
    known
        Constants of the rig, all together.
    draws
        Of noise, in every segment.

    Attributes
    ----------
    gain, dof
        (t, draws + 1) chi-squared that the free amplitudes take away from each draw and from the residual; (t,) how
        many they are.
    gram
        (t, known + 1, known + draws + 2) products of the constants' slopes and the effect on the rest with these, the
        draws of noise, and the residual.
    power
        (t, draws + 1) squares of each draw and of the residual.
    lines
        Of each candidate (3, lines) power, information and freedom of every tone.
    """

    def __init__(self, lines: Sequence[int], known: int, draws: int = 0):
        self.known = known
        self.gain = np.zeros((len(lines), draws + 1))
        self.dof = np.zeros(len(lines), int)
        self.gram = np.zeros((len(lines), known + 1, known + draws + 2))
        self.power = np.zeros((len(lines), draws + 1))
        self.lines = [np.zeros((3, n)) for n in lines]

    def add(self, columns: Columns, block: Real) -> None:
        """Take in a segment: ``block`` holds slopes, draws of noise and residual, projected by its own columns."""
        if not self.lines:
            return
        size, seen = columns.where.size, block.shape[1]
        inner = block[:, :size].T @ block, np.sum(block[:, size:] ** 2, axis=0)
        for rung in columns.ringing(np.column_stack([block, columns.own])):
            # what `own` takes up is subtracted from the products
            taken = rung.seen[:, :, seen:]
            self._add(columns, inner, rung, rung.gram - taken @ taken.swapaxes(1, 2))

    def _add(self, columns: Columns, inner: tuple[Real, Real], rung: Rung, products: Real) -> None:
        """Take in candidates with ``products`` (t, w + 1, w + 1) of their waves and effects beside the segment's.

        ``inner`` are the products of the slopes with all columns, and the power of draws and residual.
        """
        size, waves, seen = columns.where.size, products.shape[1] - 1, inner[0].shape[1]
        power = products[:, :waves, :waves]
        whole = np.diagonal(rung.gram, axis1=1, axis2=2)[:, :waves]
        sizes = np.diagonal(power, axis1=1, axis2=2)
        apart = np.all(sizes > RINGS_ITSELF * whole, axis=1)  # otherwise the rig rings at this frequency itself
        numbers, products, power = rung.numbers[apart], products[apart], power[apart]
        along = rung.seen[apart, :, :seen]
        local = np.r_[columns.where, self.known : self.gram.shape[2]]
        small = np.empty((numbers.size, size + 1, local.size))
        small[:, :size, :size], small[:, :size, size + 1 :] = inner[0][:, :size], inner[0][:, size:]
        small[:, :size, size] = small[:, size, :size] = along[:, waves, :size]
        small[:, size, size], small[:, size, size + 1 :] = products[:, waves, waves], along[:, waves, size:]
        if waves:
            across = np.insert(along[:, :waves], size, products[:, :waves, waves], axis=2)
            for i, number in enumerate(numbers):
                if self.lines[number].size:
                    self.lines[number] += _loudness(power[i], across[i, :, -1], self.lines[number].shape[1])
            scale = np.sqrt(sizes[apart])
            values, vectors = np.linalg.eigh(power / (scale[:, :, None] * scale[:, None]))
            kept = values > REPEATED
            basis = vectors * np.where(kept, 1 / np.sqrt(np.where(kept, values, 1.0)), 0.0)[:, None]
            across = basis.swapaxes(1, 2) @ (across / scale[:, :, None])
            self.gain[numbers] += np.sum(across[:, :, size + 1 :] ** 2, axis=1)
            self.dof[numbers] += kept.sum(axis=1)
            small -= across[:, :, : size + 1].swapaxes(1, 2) @ across
        self.power[numbers] += inner[1]
        self.gram[numbers[:, None, None], local[: size + 1, None], local] += small

    def take(self, other: RingingTests) -> None:
        """Add what another one was given of further segments."""
        self.gain += other.gain
        self.dof += other.dof
        self.gram += other.gram
        self.power += other.power
        for mine, others in zip(self.lines, other.lines, strict=True):
            mine += others

    def beside(self, number: int, precision: Real) -> tuple[Real, Real]:
        """Return what is left of a candidate beside the constants, which are known with a (known,) precision.

        Returns
        -------
        tuple
            (draws + 2,) products of its effect with itself, the draws and the residual; (draws + 1,) powers of these.
        """
        rest, taken = eliminated_and_taken(self.gram[number], self.known, precision)
        return rest[0], self.power[number] - self.gain[number] - taken[1:]


def _loudness(power: Real, seen: Real, lines: int) -> Real:
    """Return (3, lines) power of each line's amplitude over its variance, inverse variance, and degrees of freedom.

    ``power`` are the products of their cosines and sines (2 lines,) with each other, ``seen`` those with the residual;
    each line is read with the other lines free.
    """
    spread = np.linalg.pinv(power, hermitian=True)
    squares = ((spread @ seen) ** 2).reshape(lines, 2).sum(axis=1)
    variance = np.diag(spread).reshape(lines, 2).mean(axis=1)
    return np.array([squares / variance, 1 / variance, np.full(lines, 2.0)])
