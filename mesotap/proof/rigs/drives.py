"""Measured inputs: functions of time, known at any instant, so that a simulation may step finer than samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

Array = NDArray[np.float64]
SOFT = 1.7  # samples: width of Gaussian edges, whose spectrum is 1e-6 at half the rate
ENDING = 0.25  # of a random input's period is not recorded, so that the record is not periodic
KEPT = 16  # inputs of the rig that is being drawn
HOLDS = ("band-limited", "first", "zero")


@dataclass(frozen=True, slots=True)
class Drive:
    """An input of ``count`` samples: ``between(t)`` at times in samples, or held between samples as ``hold`` says."""

    kind: str
    count: int
    hold: str
    between: Callable[[Array], Array]

    def samples(self) -> Array:
        """Return its samples (count,)."""
        return self.between(np.arange(self.count, dtype=np.float64))

    def steps(self, pieces: int) -> Array:
        """Return it at the beginning, middle and end of each of ``pieces`` steps a sample, (steps, 3)."""
        return _steps(self, pieces)


@lru_cache(maxsize=KEPT)  # a refit asks for the same ones hundreds of times
def _steps(drive: Drive, pieces: int) -> Array:
    begin = np.arange((drive.count - 1) * pieces) / pieces
    if drive.hold == "band-limited":
        fine = drive.between(np.arange(2 * (drive.count - 1) * pieces + 1) / (2 * pieces))
        return _constant(np.stack([fine[:-1:2], fine[1::2], fine[2::2]], axis=1))
    x = drive.samples()
    first = np.floor(begin + 1e-9).astype(int)
    if drive.hold == "zero":
        return _constant(np.repeat(x[first][:, None], 3, axis=1))
    share = (begin - first)[:, None] + np.array([0.0, 0.5, 1.0]) / pieces
    return _constant(x[first][:, None] * (1 - share) + x[first + 1][:, None] * share)


def _constant(rows: Array) -> Array:
    found = np.ascontiguousarray(rows)
    found.flags.writeable = False
    return found


def nothing(count: int) -> Drive:
    """Return no input."""
    return Drive("none", count, "zero", np.zeros_like)


def lines(kind: str, count: int, band: tuple[float, float], hold: str, rng: np.random.Generator) -> Drive:
    """Return a multisine (``multisine``) or a stretch of band-limited noise (``random``).

    ``band`` is in periods per sample. A multisine has fifteen to fifty lines and one to six periods in the record.
    """
    if kind == "random":
        period = float(np.ceil(count * (1 + ENDING)))
        numbers = np.arange(max(1, int(band[0] * period)), int(band[1] * period) + 1)
        sizes = np.sqrt(rng.exponential(1.0, numbers.size))
    else:
        period = float(count // rng.integers(1, 7))
        numbers = np.unique(np.round(np.linspace(band[0], band[1], int(rng.integers(15, 51))) * period).astype(int))
        numbers = numbers[numbers > 0]
        sizes = np.ones(numbers.size)
    phases = rng.uniform(0, 2 * np.pi, numbers.size)
    scale = np.sqrt(0.5 * np.sum(sizes**2))

    def between(t: Array) -> Array:
        pieces = round((t.size - 1) / max(t[-1], 1.0))
        whole = np.zeros(int(period) * pieces // 2 + 1, dtype=np.complex128)
        whole[numbers] = sizes * np.exp(1j * phases) / scale * (period * pieces / 2)
        wave = np.fft.irfft(whole, int(period) * pieces)
        return np.asarray(np.resize(wave, t.size))

    return Drive(kind, count, hold, between)


def sweep(count: int, band: tuple[float, float], hold: str) -> Drive:
    """Return a sine whose frequency grows exponentially over the band, softly begun and ended."""
    growth = np.log(band[1] / band[0])

    def between(t: Array) -> Array:
        phase = 2 * np.pi * band[0] * count / growth * np.expm1(growth * t / count)
        edge = 0.02 * count
        envelope = np.clip(t / edge, 0, 1) * np.clip((count - t) / edge, 0, 1)
        return np.asarray(np.sqrt(2) * np.sin(phase) * np.sin(np.pi / 2 * envelope) ** 2)

    return Drive("sweep", count, hold, between)


def steps(count: int, number: int, hold: str, rng: np.random.Generator) -> Drive:
    """Return steps between random levels, sharp where ``hold`` is ``zero``, softly edged else."""
    at = np.sort(rng.uniform(0.02, 0.97, number)) * count
    jumps = np.diff(np.append(0.0, rng.uniform(-1.5, 1.5, number)))

    def between(t: Array) -> Array:
        if hold == "zero":
            return np.asarray((t[:, None] >= at) @ jumps)
        return np.asarray(0.5 * (1 + erf((t[:, None] - at) / (np.sqrt(2) * SOFT))) @ jumps)

    return Drive("steps", count, hold, between)


def hammer(count: int, number: int, width: float, rng: np.random.Generator) -> Drive:
    """Return Gaussian pulses of different strength, ``width`` samples from middle to inflexion."""
    at = (np.arange(number) + rng.uniform(0.05, 0.4, number)) * count / number
    sizes = rng.uniform(0.3, 1.0, number)

    def between(t: Array) -> Array:
        out = np.zeros(t.size)
        for middle, size in zip(at, sizes, strict=True):
            near = np.abs(t - middle) < 9 * width
            out[near] += size * np.exp(-0.5 * ((t[near] - middle) / width) ** 2)
        return out

    return Drive("hammer", count, "band-limited", between)
