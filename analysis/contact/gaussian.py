"""Rough flats with Gaussian asperity heights: Greenwood and Williamson (Sec. 2.2.2, Eq. 5).

With h = d / R_q and F_n(h) the integral of (z - h)^n over the standard normal density from h on,

    P = 4/3 eta A_n E* R_s^(1/2) R_q^(3/2) F_3/2(h),    k_c = -dP/dd = 2 eta A_n E* R_s^(1/2) R_q^(1/2) F_1/2(h).

Eq. 5 is printed with -d as its lower limit; heights below the separation d do not touch, so it is d. The factor
R_q^(3/2) belongs to heights in units of R_q. F_n has the closed form
Gamma(n + 1) / sqrt(2 pi) exp(-h^2 / 4) D_{-n-1}(h) with D the parabolic cylinder function.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from analysis.contact.inversion import GRID, separation_for_load

FloatArray = NDArray[np.float64]
DEEP = -20.0  # separation in R_q beneath which all asperities touch
HIGHEST = 37.0  # beyond it none does: the density is below the smallest number


def tail_moment(n: float, h: ArrayLike) -> FloatArray:
    """F_n(h), shaped like ``h``."""
    x = np.asarray(h, dtype=np.float64)
    usual = np.clip(x, DEEP, HIGHEST)
    closed = special.gamma(n + 1) / math.sqrt(2 * math.pi) * np.exp(-(usual**2) / 4) * special.pbdv(-n - 1, usual)[0]
    depth = np.maximum(-x, -DEEP)
    # the mean of (depth + z)^n over the normal density: binomial series, to 1e-10
    moments = (1.0, 1.0, 3.0, 15.0, 105.0)
    series = sum(special.binom(n, 2 * i) * moment * depth ** (n - 2 * i) for i, moment in enumerate(moments))
    return np.where(x < DEEP, series, np.where(x > HIGHEST, 0.0, closed))


def load(d: ArrayLike, eta: float, A_n: float, E_star: float, R_s: float, R_q: float) -> FloatArray:
    """Contact load, N, at the separation ``d``, m, shaped like ``d``; eta in 1/m2, A_n in m2, E* in Pa, radii in m."""
    amplitude = 4 / 3 * eta * A_n * E_star * math.sqrt(R_s) * R_q**1.5
    return amplitude * tail_moment(1.5, np.asarray(d, dtype=np.float64) / R_q)


def separation(P: ArrayLike, eta: float, A_n: float, E_star: float, R_s: float, R_q: float) -> FloatArray:
    """Separation d, m, at which the surfaces carry ``P``, N (shaped like ``P``); infinite where P is zero.

    `ValueError` for a load that is negative or beyond the model.
    """
    amplitude = 4 / 3 * eta * A_n * E_star * math.sqrt(R_s) * R_q**1.5
    return R_q * separation_for_load(
        P,
        amplitude * _moment_table(),
        lambda h: amplitude * tail_moment(1.5, h),
        lambda h: 1.5 * amplitude * tail_moment(0.5, h),
    )


def stiffness(P: ArrayLike, eta: float, A_n: float, E_star: float, R_s: float, R_q: float) -> FloatArray:
    """Contact stiffness, N/m, under the load ``P``, N, shaped like ``P``; zero without load. Arguments as `load`."""
    h = separation(P, eta, A_n, E_star, R_s, R_q) / R_q
    scale = 2 * eta * A_n * E_star * math.sqrt(R_s * R_q)
    touching = np.isfinite(h)
    return np.where(touching, scale * tail_moment(0.5, np.where(touching, h, 0.0)), 0.0)


def contact_area(P: ArrayLike, eta: float, A_n: float, E_star: float, R_s: float, R_q: float) -> FloatArray:
    """Area in which asperities touch, m2, under the load ``P``, N, shaped like it: pi eta A_n R_s R_q F_1(h)."""
    h = separation(P, eta, A_n, E_star, R_s, R_q) / R_q
    return math.pi * eta * A_n * R_s * R_q * tail_moment(1.0, h)


@functools.cache
def _moment_table() -> FloatArray:
    return tail_moment(1.5, GRID)
