"""Rough sphere on a flat at every load: Greenwood and Tripp (Sec. 2.1, beyond Eq. 3).

Asperities stand on a sphere whose bulk gives way beneath them. At the radius r the mean planes are apart by

    u(r) = d + r^2 / 2R + w(r),    p(r) = 4/3 eta E* R_s^(1/2) R_q^(3/2) F(u / R_q),

with the bulk's deflection w under the pressure p, and F the load of asperities with Gaussian heights: F_3/2 of
`gaussian`, or Eq. 6 where they yield. With heights in R_q, radii in (2 R R_q)^(1/2) and pressures in E* (R_q /
8R)^(1/2),

    u = h + rho^2 + w,    p = mu F(u),    mu = 8/3 eta R_q (2 R R_s)^(1/2),

w as in `bulk`, and the load is J = int p rho d(rho) = P / (pi E* R_q (2 R R_q)^(1/2)): for elastic asperities
everything follows from J and mu. Pressure and separation are found together by Newton's method; the stiffness
-dP/dd is the same linear system solved once more.

Limits. Light load: the bulk keeps its shape, P = 2 pi R int_d p du and k_c = 2 pi R p(d). Heavy load: Hertz, Eq. 2. In
between, k_c over that of Eq. 2 rises from 0 to 1 without pausing at the third of Eq. 3, which it passes near
a_0^2 = R R_q / 4, a_0 the contact radius of Hertz.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import interpolate, linalg

from analysis.contact import gaussian, hertz
from analysis.contact.bulk import unit_disc
from analysis.contact.elastic_plastic import ElasticPlasticFlats
from analysis.contact.inversion import TheoryError

FloatArray = NDArray[np.float64]
NODES = 64
LIGHTEST, HEAVIEST = 1e-7, 1e9  # J; the heavier is the end of `RoughSphere.load` alone
BISECTIONS = 60
SMOOTHEST = 1e-3  # R R_q / a_0^2; for mu = 1, roughness takes 0.3 % off Hertz's stiffness there
STEPS_PER_DECADE = 6
WIDE = 5.0  # a_0^2 / (2 R R_q) from which on a contact is nearer to Hertz's than to the undeformed shape
MOST_STEPS, CONVERGED = 60, 1e-10  # of Newton's method; R_q


@dataclass(frozen=True, slots=True)
class RoughSphere:
    """A sphere on a flat, with the roughness of both.

    Attributes
    ----------
    R
        Radius of the sphere, m.
    E_star
        Composite modulus, Pa.
    eta
        Asperities per area, 1/m2.
    R_s, R_q
        Asperity radius and rms roughness of both surfaces together, m.
    H
        Hardness of the softer body, Pa; infinite for elastic asperities.
    nu
        Poisson's ratio of that body.
    """

    R: float
    E_star: float
    eta: float
    R_s: float
    R_q: float
    H: float = math.inf
    nu: float = 0.29

    @property
    def mu(self) -> float:
        """Asperities' stiffness beside the bulk's: Greenwood and Tripp's mu."""
        return 8 / 3 * self.eta * self.R_q * math.sqrt(2 * self.R * self.R_s)

    @property
    def critical_interference(self) -> float:
        """Interference at which an asperity yields, in R_q."""
        if math.isinf(self.H):
            return math.inf
        return ElasticPlasticFlats(
            self.eta, 1.0, self.E_star, self.R_s, self.R_q, self.H, self.nu
        ).critical_interference

    @property
    def load_unit(self) -> float:
        """Load at J = 1, N."""
        return math.pi * self.E_star * self.R_q * math.sqrt(2 * self.R * self.R_q)

    def load(self, d: ArrayLike) -> FloatArray:
        """Contact load, N, at the separation ``d``, m, shaped like it.

        `TheoryError` for a separation at which less than 1e-7 or more than 1e9 `load_unit` is carried.
        """
        wanted = np.asarray(d, dtype=np.float64)
        low, high = (np.full(wanted.shape, math.log(J)) for J in (LIGHTEST, HEAVIEST))
        ends = self.separation([LIGHTEST * self.load_unit * (1 + 1e-12), HEAVIEST * self.load_unit])
        if not ((wanted <= ends[0]) & (wanted >= ends[1])).all():
            raise TheoryError(
                f"separations from {ends[1] * 1e6:.3g} to {ends[0] * 1e6:.3g} um are covered for this rough sphere"
            )
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            apart = self.separation(self.load_unit * np.exp(middle)) > wanted
            low, high = np.where(apart, middle, low), np.where(apart, high, middle)
        return np.asarray(self.load_unit * np.exp(high), dtype=np.float64)

    def separation(self, P: ArrayLike) -> FloatArray:
        """Separation d, m, of the undeformed mean surfaces at the axis under the load ``P``, N, shaped like it.

        Falls as the bodies approach; infinite without load. `TheoryError` for a load below 1e-7 `load_unit`.
        """
        J = self._dimensionless(P)
        table = _table(self.mu, self.critical_interference)
        kept_apart = table.kept_apart(np.log(np.clip(J, LIGHTEST, table.heaviest)))
        return np.where(J > 0, self.R_q * (kept_apart - hertz_approach(J)), np.inf)

    def stiffness(self, P: ArrayLike) -> FloatArray:
        """Contact stiffness -dP/dd, N/m, under the load ``P``, N, shaped like it; zero without load.

        Beyond R R_q / a_0^2 = 1e-3 what roughness takes off Hertz's stiffness is continued as the load^(-4/9).
        """
        share = hertz_share(self._dimensionless(P), self.mu, self.critical_interference)
        return np.asarray(share * hertz.stiffness(P, self.R, self.E_star), dtype=np.float64)

    def unloading_stiffness(self, P: ArrayLike) -> FloatArray:
        """Contact stiffness, N/m, of small elastic unloading from ``P``, N; that of loading if no asperity yields."""
        share = hertz_share(self._dimensionless(P), self.mu, self.critical_interference, unloading=True)
        return np.asarray(share * hertz.stiffness(P, self.R, self.E_star), dtype=np.float64)

    def contact_area(self, P: ArrayLike) -> FloatArray:
        """Area in which asperities touch, m2, under the load ``P``, N, shaped like it; zero without load."""
        J = self._dimensionless(P)
        table = _table(self.mu, self.critical_interference)
        if (table.heaviest < J).any():
            raise TheoryError(
                f"above {table.heaviest * self.load_unit:.3g} N this sphere is smooth; Eq. 1 gives its area"
            )
        unit = 2 * math.pi**2 * self.eta * self.R_s * self.R_q * 2 * self.R * self.R_q
        return np.where(J > 0, unit * np.exp(table.area(np.log(np.maximum(J, LIGHTEST)))), 0.0)

    def pressure(self, P: float) -> tuple[FloatArray, FloatArray]:
        """Pressure over the contact under the load ``P``, N: (n,) radii, m, and (n,) nominal pressures, Pa."""
        J = float(self._dimensionless(P))
        table = _table(self.mu, self.critical_interference)
        if not 0 < J <= table.heaviest:
            raise TheoryError(f"no pressure of rough surfaces for a load of {P:g} N")
        load, slope, *_ = _asperities(self.critical_interference)
        start = _Solution.of(int(np.searchsorted(table.loads, J)) - 1, table)
        solved = _solve(J, self.mu, load, slope, start)
        unit = self.E_star * math.sqrt(self.R_q / (8 * self.R))
        return math.sqrt(2 * self.R * self.R_q) * np.sqrt(solved.square), unit * self.mu * load(solved.gap)

    def _dimensionless(self, P: ArrayLike) -> FloatArray:
        loads = np.asarray(P, dtype=np.float64)
        if not np.all(loads >= 0):
            raise TheoryError("surfaces in contact carry no negative load")
        J = loads / self.load_unit
        if ((J < LIGHTEST) & (J > 0)).any():
            raise TheoryError(
                f"a load of {float(loads[loads > 0].min()):.3g} N is below the {LIGHTEST * self.load_unit:.3g} N from "
                "which on this rough sphere is solved"
            )
        return np.asarray(J, dtype=np.float64)


def hertz_share(J: ArrayLike, mu: float, omega_c: float = math.inf, unloading: bool = False) -> FloatArray:
    """Stiffness over that of the smooth sphere under the same load, Eq. 2, shaped like the dimensionless load ``J``.

    Of loading, or of elastic ``unloading`` where asperities have yielded.
    """
    load = np.asarray(J, dtype=np.float64)
    table = _table(mu, omega_c)
    of = table.unloading_share if unloading else table.hertz_share
    share = np.exp(of(np.log(np.clip(load, LIGHTEST, table.heaviest))))
    return np.asarray(1 - (1 - share) * np.maximum(load / table.heaviest, 1) ** (-4 / 9), dtype=np.float64)


def hertz_radius_squared(J: ArrayLike) -> FloatArray:
    """Square of Hertz's contact radius in 2 R R_q: that is a_0^2 / (2 R R_q), so R R_q / a_0^2 = 1 / (2 * this)."""
    return np.asarray((3 * math.pi * np.asarray(J, dtype=np.float64) / 8) ** (2 / 3), dtype=np.float64)


def hertz_approach(J: ArrayLike) -> FloatArray:
    """Hertz's approach, Eq. 1, in R_q."""
    return 2 * hertz_radius_squared(J)


Law = Callable[[FloatArray], FloatArray]


def _asperities(omega_c: float) -> tuple[Law, Law, Law, Law]:
    """F(u), -F'(u), the same in unloading, and the share of area, in pi eta R_s R_q, of asperities.

    They yield at ``omega_c``.
    """
    if math.isinf(omega_c):
        return (
            lambda u: gaussian.tail_moment(1.5, u),
            lambda u: 1.5 * gaussian.tail_moment(0.5, u),
            lambda u: 1.5 * gaussian.tail_moment(0.5, u),
            lambda u: gaussian.tail_moment(1.0, u),
        )
    flats = ElasticPlasticFlats.normalised(omega_c)
    return flats.load, flats.slope, flats.unloading_slope, lambda u: flats.area_at(u) / (0.75 * math.pi)


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    """The problem at one load: (n,) rho^2 and u at the nodes, h, -dJ/dh, the same in unloading, and the area."""

    square: FloatArray
    gap: FloatArray
    h: float
    stiffness: float
    unloading: float
    area: float

    @staticmethod
    def of(row: int, table: _Table) -> _Solution:
        """Return a row of a table."""
        return table.solutions[max(row, 0)]


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """Everything against log J, for one mu.

    The (m,) loads J solved; h with Hertz's approach added, so what asperities keep the bodies apart; log of k over
    Hertz's; log of the area.
    """

    loads: FloatArray
    kept_apart: interpolate.PPoly
    hertz_share: interpolate.PPoly
    unloading_share: interpolate.PPoly
    area: interpolate.PPoly
    solutions: tuple[_Solution, ...]

    @property
    def heaviest(self) -> float:
        """Largest J solved."""
        return float(self.loads[-1])


@functools.lru_cache(maxsize=128)
def _table(mu: float, omega_c: float) -> _Table:
    heaviest = 8 / (3 * math.pi) * (2 * SMOOTHEST) ** -1.5
    loads = np.geomspace(LIGHTEST, heaviest, round(STEPS_PER_DECADE * math.log10(heaviest / LIGHTEST)) + 1)
    load, slope, unloading, area = _asperities(omega_c)
    last, solutions = _lightest(mu), []
    for J in loads:
        last = _solve(float(J), mu, load, slope, last, (unloading, area))
        solutions.append(last)
    log_J = np.log(loads)
    stiffness = np.array([s.stiffness for s in solutions])
    approach = hertz_approach(loads)
    by_hertz = math.pi / (2 * np.sqrt(hertz_radius_squared(loads)))
    elastic = np.array([s.unloading for s in solutions])
    return _Table(
        loads,
        interpolate.CubicHermiteSpline(
            log_J, [s.h for s in solutions] + approach, 2 / 3 * approach - loads / stiffness
        ),
        interpolate.CubicSpline(log_J, np.log(stiffness * by_hertz)),
        interpolate.CubicSpline(log_J, np.log(elastic * by_hertz)),
        interpolate.CubicSpline(log_J, np.log([s.area for s in solutions])),
        tuple(solutions),
    )


def _lightest(mu: float) -> _Solution:
    """Where to begin: elastic asperities on a bulk that keeps its shape, J = mu F_5/2(h) / 5."""
    h = np.linspace(-5, 9, 281)
    at = float(np.interp(-math.log(LIGHTEST), -np.log(mu * gaussian.tail_moment(2.5, h) / 5), h))
    square = 10 * unit_disc(NODES).square
    return _Solution(square, at + square, at, 0.0, 0.0, 0.0)


def _start(J: float, square: FloatArray, near: _Solution) -> tuple[FloatArray, float]:
    """Return where Newton's method begins: u of a load nearby, stretched with the contact where that is Hertz's."""
    a2 = float(hertz_radius_squared(J))
    stretch = square[-1] / near.square[-1] if a2 > WIDE else 1.0
    beyond = np.maximum(square / stretch - near.square[-1], 0.0)  # there the surfaces part as they were shaped
    u = np.interp(square / stretch, near.square, near.gap) + beyond
    if a2 < WIDE:
        return u, near.h
    nearby_a2 = near.square[-1] * a2 / square[-1]
    return u, near.h - 2 * (a2 - nearby_a2)


def _solve(
    J: float, mu: float, load: Law, slope: Law, start: _Solution, more: tuple[Law, Law] | None = None
) -> _Solution:
    """Solve at the load J from the solution at a load nearby; ``more`` are the unloading slope and the area."""
    disc = unit_disc(NODES)
    a2 = float(hertz_radius_squared(J))
    b2 = a2 + 6 + 0.9 * a2 ** (2 / 3)  # beyond, no asperity touches
    square, weight, bulk = b2 * disc.square, b2 * disc.weight, math.sqrt(b2) * disc.deflection
    u, h = _start(J, square, start)
    ones = np.ones(NODES)
    for _ in range(MOST_STEPS):
        p, s = mu * load(u), mu * slope(u)
        residual = u - h - square - bulk @ p
        by_residual, by_h = linalg.solve(np.eye(NODES) + bulk * s, np.stack([residual, ones], axis=1)).T
        carried = float(weight @ p)
        ratio = J / carried if carried > 0 else math.inf
        # log J is nearly linear in h, but for a start far off
        wanted = carried * math.log(ratio) if 0.05 < ratio < 20 else J - carried
        dh = float(weight @ (s * by_residual) - wanted) / float(weight @ (s * by_h))
        du = by_h * dh - by_residual
        largest = max(float(np.abs(du).max()), abs(dh))
        step = min(1.0, max(2.0, 0.3 * abs(h)) / largest) if largest > 0 else 1.0
        u, h = u + step * du, h + step * dh
        if largest < CONVERGED * max(1.0, abs(h)):
            break
    else:
        raise TheoryError(f"the rough sphere was not solved at J = {J:.3g}, mu = {mu:.3g}")

    def stiffness(s: FloatArray) -> float:
        return float(weight @ (s * linalg.solve(np.eye(NODES) + bulk * s, ones)))

    loading = stiffness(mu * slope(u))
    if more is None:
        return _Solution(square, u, h, loading, math.nan, math.nan)
    unloading, area = more
    return _Solution(square, u, h, loading, stiffness(mu * unloading(u)), float(weight @ area(u)))
