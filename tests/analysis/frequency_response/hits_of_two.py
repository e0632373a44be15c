"""Hits on the tester of Eq. 9 with a measured force, computed by modal superposition of the closed form."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from analysis.frequency_response.impacts import HitRecord

Real = NDArray[np.float64]
RATE = 25_000.0
M1, M2, K1, K2 = 0.107, 0.108, 5.38e5, 5.38e5


def receptance(s: NDArray[np.complex128], m1: float, m2: float, kc: float, cc: float, seen: int = 1, c: float = 0.0):
    """Return x_seen / F1 of Eq. 9 by Cramer's rule on its dynamic stiffness, m/N."""
    upper = m1 * s**2 + c * s + K1 + kc + cc * s
    lower = m2 * s**2 + c * s + K2 + kc + cc * s
    coupling = -(kc + cc * s)
    determinant = upper * lower - coupling**2
    return (lower if seen == 0 else -coupling) / determinant


def hits(
    rng: np.random.Generator,
    kc: float,
    cc: float,
    count: int = 6,
    m1: float = M1,
    m2: float = M2,
    c: float = 4.0,
    gain: float = 1.0,
    noise: float = 1e-3,
    force_noise: float = 1e-3,
    scatter: float = 0.0,
    duration_s: float = 3e-4,
    samples: int = 5000,
    seen: tuple[int, ...] = (1,),
    shape: Callable[[Real], Real] | None = None,
) -> list[HitRecord]:
    """Return records of half-sine hits on the upper mass, integrated by SciPy at 8 times the rate.

    ``gain`` is the force read over the true one, ``scatter`` the standard deviation of k_c from hit to hit, relative.
    """
    records = []
    fine, over = RATE * 8, 8
    t = np.arange(samples * over) / fine
    for number in range(count):
        stiffness = kc * (1 + scatter * rng.standard_normal())
        k = np.array([[K1 + stiffness, -stiffness], [-stiffness, K2 + stiffness]])
        d = np.array([[c + cc, -cc], [-cc, c + cc]])
        mass = np.array([[m1], [m2]])
        a = np.block([[np.zeros((2, 2)), np.eye(2)], [-k / mass, -d / mass]])
        b = np.array([[0.0], [0.0], [1 / m1], [0.0]])
        peak = 8 * (1 + 0.2 * rng.standard_normal())
        begin = (250 + rng.uniform()) / RATE
        inside = (t >= begin) & (t < begin + duration_s)
        force = np.where(inside, peak * np.sin(math.pi * (t - begin) / duration_s), 0.0)
        if shape is not None:
            force = shape(force)
        rows = [2 + i for i in seen]
        system = signal.StateSpace(a, b, a[rows], b[rows])
        response = signal.lsim(system, force, t)[1].reshape(len(t), -1).T
        low = signal.butter(6, 10_000.0, fs=fine, output="sos")
        both = signal.sosfilt(low, np.vstack([force, response]))[:, ::over]
        read = gain * both[0] + force_noise * rng.standard_normal(samples)
        records.append(HitRecord(read, both[1:] + noise * rng.standard_normal(both[1:].shape), f"hit {number}"))
    return records
