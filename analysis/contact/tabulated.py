"""Theories of rough contact for whole arrays of surfaces at once, interpolated between tables of their few numbers."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate

from analysis.contact import gaussian, hertz
from analysis.contact.elastic_plastic import ElasticPlasticFlats
from analysis.contact.inversion import GRID
from analysis.contact.rough_sphere import RoughSphere, hertz_share
from analysis.contact.theory import Surfaces

FloatArray = NDArray[np.float64]
Number = FloatArray | float
Law = Callable[[FloatArray], FloatArray]  # k_c, N/m, of loads, N
PER_DECADE = 4  # tables of the rough sphere over mu


@functools.cache
def gaussian_flats() -> Callable[[FloatArray], FloatArray]:
    """k_c R_q over 4/3 eta A_n E* R_s^(1/2) R_q^(3/2), against the load over the same."""
    load, slope = gaussian.tail_moment(1.5, GRID)[::-1], 1.5 * gaussian.tail_moment(0.5, GRID)[::-1]
    curve = interpolate.CubicSpline(np.log(load), np.log(slope))
    return lambda P: np.exp(curve(np.log(P)))


@functools.cache
def _yielding_table(unloading: bool) -> tuple[interpolate.RectBivariateSpline, FloatArray, FloatArray]:
    log_omega, log_load = (
        np.linspace(math.log(1e-6), math.log(1e3), 64),
        np.linspace(math.log(1e-8), math.log(1e2), 160),
    )
    rows = []
    h = GRID[(GRID > -15) & (GRID < 9)]
    for omega_c in np.exp(log_omega):
        flats = ElasticPlasticFlats.normalised(float(omega_c))
        slope = flats.unloading_slope(h) if unloading else flats.slope(h)
        rows.append(interpolate.CubicSpline(np.log(flats.load(h)[::-1]), np.log(slope[::-1]))(log_load))
    return interpolate.RectBivariateSpline(log_omega, log_load, np.array(rows)), log_omega, log_load


def yielding_flats(omega_c: FloatArray, P: FloatArray, unloading: bool = False) -> FloatArray:
    """Return what `gaussian_flats` does for asperities that yield at ``omega_c`` R_q; NaN beyond the table.

    Of first loading, or of elastic ``unloading``.
    """
    table, log_omega, log_load = _yielding_table(unloading)
    x, y = np.broadcast_arrays(np.log(omega_c), np.log(P))
    outside = (x < log_omega[0]) | (x > log_omega[-1]) | (y < log_load[0]) | (y > log_load[-1])
    return np.where(outside, np.nan, np.exp(table.ev(x, y)))


def rough_sphere(
    s: Surfaces, R: Number, factor: FloatArray, H: float = math.inf, density: Number = 1.0, unloading: bool = False
) -> Law:
    """Greenwood and Tripp for arrays of R, roughness and asperity density, interpolated between tables in mu."""
    R_q = s.R_q * factor
    mu = 8 / 3 * s.eta * density * R_q * np.sqrt(2 * R * s.R_s)
    omega_c = RoughSphere(1.0, s.E_star, s.eta, s.R_s, s.R_q, H, s.nu).critical_interference
    unit = math.pi * s.E_star * R_q * np.sqrt(2 * R * R_q)

    def law(P: FloatArray) -> FloatArray:
        J, of = np.broadcast_arrays(P / unit, mu)
        x, y = PER_DECADE * np.log10(of), np.log(J)
        first, last = math.floor(x.min()) - 1, math.ceil(x.max()) + 1
        ends = float(y.min()), float(y.max()) + 1e-9
        along = np.linspace(*ends, 64)
        rungs = np.arange(first, last + 1)
        mus = (10.0 ** (rung / PER_DECADE) for rung in rungs.tolist())
        shares = np.log([hertz_share(np.exp(along), value, omega_c, unloading) for value in mus])
        share = interpolate.RectBivariateSpline(rungs, along, shares).ev(x, y)
        return np.exp(share) * hertz.stiffness(P, 1.0, s.E_star) * np.cbrt(R)

    return law
