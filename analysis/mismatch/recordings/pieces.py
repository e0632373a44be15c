"""Spectra of pieces of recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.mismatch.recordings.recorded import Recorded, level
from analysis.mismatch.rig_description import Hold
from sim_backend.arrays import Complex, Real


@dataclass(frozen=True, slots=True)
class Piece:
    """Spectra of a piece of a recording at ``s`` (lines,): channels (c, lines) over their levels, inputs."""

    s: Complex
    outputs: Complex
    inputs: Complex
    level: Real

    @classmethod
    def of(cls, recorded: Recorded, at: slice, alpha: float, hold: Hold, lines: int) -> Piece:
        """Return the strongest lines of the samples ``at``, weighed by ``exp(-alpha t)``."""
        levels, rate = level(recorded), recorded.rate_hz
        y = recorded.outputs[:, at] - recorded.outputs.mean(axis=1, keepdims=True)
        u = recorded.inputs[:, at]
        n = y.shape[1]
        weight = np.exp(-alpha * np.arange(n) / rate) / rate
        outputs = np.fft.rfft(y * weight, axis=1) / levels[:, None]
        inputs = np.fft.rfft((u - recorded.inputs.mean(axis=1, keepdims=True)) * weight, axis=1)
        power = np.sum(np.abs(outputs) ** 2, axis=0)
        power[0] = 0.0
        used = np.sort(np.argsort(power[: int(0.9 * power.size)])[::-1][:lines])
        s = np.asarray(alpha + 2j * np.pi * np.fft.rfftfreq(n, 1 / rate)[used], np.complex128)
        return cls(s, outputs[:, used], inputs[:, used] * held(s / rate, hold), levels)


@dataclass(frozen=True, slots=True)
class Pieces:
    """Spectra of pieces with as many lines each: ``s`` (p, lines), channels (p, lines, c), inputs (p, lines, u)."""

    s: Complex
    outputs: Complex
    inputs: Complex
    level: Real

    @classmethod
    def of(cls, pieces: Sequence[Piece]) -> list[Pieces]:
        """Return pieces together with those that have as many lines."""
        found: dict[int, list[Piece]] = {}
        for piece in pieces:
            found.setdefault(piece.s.size, []).append(piece)
        return [
            cls(
                np.array([p.s for p in alike]), np.array([p.outputs.T for p in alike]),
                np.array([p.inputs.T for p in alike]), np.array([p.level for p in alike]),
            )
            for alike in found.values()
        ]  # fmt: skip


def held(sh: Complex, hold: Hold) -> Complex:
    """Return what an input's spectrum is multiplied by for what it does between samples, at ``s`` times their time."""
    if hold == "band-limited":
        return np.ones(sh.size, np.complex128)
    step = -np.expm1(-sh) / sh
    return np.asarray(step if hold == "zero" else step**2 * np.exp(sh), np.complex128)
