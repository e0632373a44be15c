"""Recordings of small rigs by scipy's own integrators: another code path than the one that diagnoses them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from daq.exchange import Recording

Real = NDArray[np.float64]
SAMPLES, RATE = 2400, 200.0
OMEGA = 2 * np.pi * 12
SPRING = """
bodies: {mass: 1}
springs: [{between: [mass, ground], damping: unknown}]
"""
INPUT = "inputs: [{channel: 0, force_on: mass, gain: unknown}]\n"
JOINT = """
bodies: {mass: 1}
joints: [{between: [mass, ground]}]
sensors: [{channel: 0, of: mass, shows: displacement}]
"""


def noise_input(samples: int, rate: float, low: float, high: float, seed: int) -> Real:
    """Band-limited noise of unit variance."""
    random = np.random.default_rng(seed)
    spectrum = np.fft.rfft(random.normal(size=samples))
    f = np.fft.rfftfreq(samples, 1 / rate)
    spectrum[(f < low) | (f > high)] = 0
    u = np.fft.irfft(spectrum, samples)
    return u / u.std()


def motion(
    rest: Callable[[float, Real, Real], Real], start: list[float], samples: int, rate: float, u: Real | None = None
) -> Real:
    """Return states (2n, samples) of ``x'' = rest(u, x, v)``."""
    n = len(start) // 2
    t = np.arange(samples) / rate
    drive = _between(t, u) if u is not None else lambda s: 0.0

    def slope(s: float, z: Real) -> Real:
        return np.concatenate([z[n:], np.atleast_1d(rest(drive(s), z[:n], z[n:]))])

    return solve_ivp(slope, (0, t[-1]), start, t_eval=t, method="DOP853", rtol=1e-9, atol=1e-12, max_step=1 / rate).y


def _between(t: Real, u: Real) -> Callable[[float], float]:
    """Return the cubic spline through samples (n,), a number at a time: scipy's takes ten times as long for one."""
    cubic, square, slope, value = CubicSpline(t, u).c.tolist()
    last, step = t.size - 2, float(t[1])

    def at(s: float) -> float:
        i = min(int(s / step), last)
        d = s - i * step
        return ((cubic[i] * d + square[i]) * d + slope[i]) * d + value[i]

    return at


@cache
def driven() -> tuple[Real, Real, Real]:
    """Return what drives a mass of one mode at 12 Hz, its displacement and its velocity, (SAMPLES,) each."""
    u = noise_input(SAMPLES, RATE, 0.5, 40, seed=5)
    x, v = motion(lambda s, x, v: 100 * s - OMEGA**2 * x - 0.08 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u)
    return u, x, v


def recorded(columns: list[Real], rate: float, noise: float, seed: int = 1) -> Recording:
    """Return a recording whose last columns have noise, in shares of their rms, that the first (an input) has not."""
    random = np.random.default_rng(seed)
    data = np.array(columns)
    data[-1] += noise * data[-1].std() * random.normal(size=data.shape[1])
    return Recording(data, rate, tuple(f"column{i + 1}" for i in range(len(data))), "", "simulated")


def sensor(shows: str, channel: int = 1) -> str:
    return f"sensors: [{{channel: {channel}, of: mass, shows: {shows}}}]\n"


def duffing(u: Real) -> Recording:
    y = motion(
        lambda s, x, v: 100 * s - OMEGA**2 * x * (1 + 8 * x * x) - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u
    )
    return recorded([u, y[1]], RATE, 0.01)
