"""Rough flats with Gaussian heights whose highest asperities yield: Chang, Etsion and Bogy (Sec. 2.2.2, Eq. 6).

With lengths in R_q, h = d / R_q and omega_c = (pi K H / 2 E*)^2 R_s / R_q, K = 0.454 + 0.41 nu,

    P = 4/3 eta A_n E* R_s^(1/2) R_q^(3/2) I_e(h) + pi R_s K H eta A_n R_q I_p(h),

I_e integrates t^(3/2) phi(h + t) over t from 0 to omega_c, I_p integrates (2 t - omega_c) phi(h + t) from omega_c on,
phi the standard normal density. Eq. 6 is printed without R_q^(3/2) and R_q, which heights in units of R_q need.
The standard deviation of the asperity heights is taken as R_q, as in Eq. 5.

Two stiffnesses follow from it. Along first loading it is -dP/dd. Whatever lets go and presses again by less than it has
been pressed, as a ring-down or ultrasound does, finds yielded asperities elastic: each is a spot of the area that it
has, with 2 E* times the spot's radius (Kim, Baltazar and Rokhlin, J. Mech. Phys. Solids 52, 2004, 1911),

    k = 2 eta A_n E* (R_s R_q)^(1/2) (J_e(h) + J_p(h)),

J_e the integral of t^(1/2) phi(h + t) over t from 0 to omega_c, J_p that of (2 t - omega_c)^(1/2) phi(h + t) from
omega_c on.

The interaction of the spots through the bulk is left out of both.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from analysis.contact import gaussian
from analysis.contact.inversion import GRID, separation_for_load

FloatArray = NDArray[np.float64]
HARDNESS_SHARE = 0.454  # K of a body with Poisson's ratio 0
_REACH = 12.0  # standard deviations above the mean; no asperity is higher
_NODES, _WEIGHTS = special.roots_jacobi(80, 0.0, 1.5)  # for integrals with t^(3/2)
_ROOT_NODES, _ROOT_WEIGHTS = special.roots_jacobi(80, 0.0, 0.5)  # for integrals with t^(1/2)


@dataclass(frozen=True, slots=True)
class ElasticPlasticFlats:
    """Surfaces in contact.

    Attributes
    ----------
    eta
        Asperities per area, 1/m2.
    A_n
        Nominal area, m2.
    E_star
        Composite modulus, Pa.
    R_s, R_q
        Asperity radius and rms roughness, m.
    H
        Hardness of the softer body, Pa.
    nu
        Poisson's ratio of that body.
    """

    eta: float
    A_n: float
    E_star: float
    R_s: float
    R_q: float
    H: float
    nu: float

    @classmethod
    def normalised(cls, omega_c: float) -> ElasticPlasticFlats:
        """Return surfaces that yield at ``omega_c`` R_q, with R_q = 1 and the factor of I_e equal to 1."""
        return cls(0.75, 1.0, 1.0, 1.0, 1.0, 2 * math.sqrt(omega_c) / (math.pi * HARDNESS_SHARE), 0.0)

    @property
    def critical_interference(self) -> float:
        """Interference omega_c at which an asperity yields, in R_q."""
        return (math.pi * self._KH / (2 * self.E_star)) ** 2 * self.R_s / self.R_q

    @property
    def plasticity_index(self) -> float:
        """CEB's plasticity index, omega_c^(-1/2): below 0.6 asperities are elastic, above 1 they yield at any load."""
        return self.critical_interference**-0.5

    def load(self, d: ArrayLike) -> FloatArray:
        """Contact load, N, at the separation ``d``, m, shaped like ``d``."""
        return self._load(np.asarray(d, dtype=np.float64) / self.R_q)

    def slope(self, d: ArrayLike) -> FloatArray:
        """Contact stiffness -dP/dd, N/m, at the separation ``d``, m, shaped like ``d``."""
        return self._slope(np.asarray(d, dtype=np.float64) / self.R_q) / self.R_q

    def unloading_slope(self, d: ArrayLike) -> FloatArray:
        """Elastic stiffness, N/m, of the spots that touch at the separation ``d``, m, shaped like ``d``."""
        h = np.asarray(d, dtype=np.float64) / self.R_q
        return 2 * self.eta * self.A_n * self.E_star * math.sqrt(self.R_s * self.R_q) * self._spots(h)

    def yielded_share(self, P: ArrayLike) -> FloatArray:
        """Share of the load ``P``, N, that asperities carry which have yielded, shaped like it; zero without load."""
        h = self.separation(P) / self.R_q
        touching = np.isfinite(h)
        carried = self._amplitudes()[0] * self._elastic(np.where(touching, h, 0.0), 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(touching, 1 - carried / np.asarray(P, dtype=np.float64), 0.0)

    def area_at(self, d: ArrayLike) -> FloatArray:
        """Area in which asperities touch, m2, at the separation ``d``, m, shaped like ``d``.

        pi R_s omega of an elastic asperity, pi R_s (2 omega - omega_c) of one that yields.
        """
        h = np.asarray(d, dtype=np.float64) / self.R_q
        return (
            math.pi
            * self.eta
            * self.A_n
            * self.R_s
            * self.R_q
            * (_mean_excess(h) + _mean_excess(h + self.critical_interference))
        )

    def contact_area(self, P: ArrayLike) -> FloatArray:
        """Area in which asperities touch, m2, under the load ``P``, N, shaped like it; zero without load."""
        d = self.separation(P)
        touching = np.isfinite(d)
        return np.where(touching, self.area_at(np.where(touching, d, 0.0)), 0.0)

    def separation(self, P: ArrayLike) -> FloatArray:
        """Separation d, m, under the load ``P``, N, shaped like it; `ValueError` for a load beyond the model."""
        return self.R_q * separation_for_load(P, _load_table(self), self._load, self._slope)

    def stiffness(self, P: ArrayLike) -> FloatArray:
        """Contact stiffness of first loading, -dP/dd, N/m, under the load ``P``, N, shaped like it; zero at no load."""
        h = self.separation(P) / self.R_q
        touching = np.isfinite(h)
        return np.where(touching, self._slope(np.where(touching, h, 0.0)) / self.R_q, 0.0)

    def unloading_stiffness(self, P: ArrayLike) -> FloatArray:
        """Contact stiffness of small elastic unloading from the load ``P``, N/m, shaped like it; zero without load."""
        d = self.separation(P)
        touching = np.isfinite(d)
        return np.where(touching, self.unloading_slope(np.where(touching, d, 0.0)), 0.0)

    @property
    def _KH(self) -> float:  # noqa: N802 - K H of Eq. 6
        return (HARDNESS_SHARE + 0.41 * self.nu) * self.H

    def _amplitudes(self) -> tuple[float, float]:
        """Factors of I_e and I_p, N."""
        per_asperity = self.eta * self.A_n
        return (
            4 / 3 * per_asperity * self.E_star * math.sqrt(self.R_s) * self.R_q**1.5,
            math.pi * self.R_s * self._KH * per_asperity * self.R_q,
        )

    def _load(self, h: FloatArray) -> FloatArray:
        elastic, plastic = self._amplitudes()
        beyond = h + self.critical_interference
        yielding = 2 * _mean_excess(beyond) + self.critical_interference * special.ndtr(-beyond)
        return elastic * self._elastic(h, 0) + plastic * yielding

    def _slope(self, h: FloatArray) -> FloatArray:
        """-dP/dh, N."""
        elastic, plastic = self._amplitudes()
        beyond = h + self.critical_interference
        yielding = 2 * special.ndtr(-beyond) + self.critical_interference * _density(beyond)
        return elastic * self._elastic(h, 1) + plastic * yielding

    def _elastic(self, h: FloatArray, power: int) -> FloatArray:
        """Integral of t^(3/2) (h + t)^power phi(h + t) up to omega_c; -phi' (z) = z phi(z) makes power 1 the slope."""
        upper = np.minimum(self.critical_interference, np.maximum(-h, 0.0) + _REACH)[..., None]
        z = h[..., None] + upper * (1 + _NODES) / 2
        return np.asarray((upper[..., 0] / 2) ** 2.5 * (_WEIGHTS * z**power * _density(z)).sum(-1), dtype=np.float64)

    def _spots(self, h: FloatArray) -> FloatArray:
        """J_e + J_p; with t = omega_c / 2 + w, J_p is an integral over w from zero on less one up to omega_c / 2."""
        c = self.critical_interference
        yielded = gaussian.tail_moment(0.5, h + c / 2) - _root_moment(h + c / 2, c / 2)
        return _root_moment(h, c) + math.sqrt(2) * np.maximum(yielded, 0.0)


def _root_moment(h: FloatArray, end: float) -> FloatArray:
    """Integral of t^(1/2) phi(h + t) from 0 to ``end``."""
    upper = np.minimum(end, np.maximum(-h, 0.0) + _REACH)[..., None]
    z = h[..., None] + upper * (1 + _ROOT_NODES) / 2
    return np.asarray((upper[..., 0] / 2) ** 1.5 * (_ROOT_WEIGHTS * _density(z)).sum(-1), dtype=np.float64)


@functools.lru_cache(maxsize=8)
def _load_table(flats: ElasticPlasticFlats) -> FloatArray:
    return flats._load(GRID)


def _density(z: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi), dtype=np.float64)


def _mean_excess(h: FloatArray) -> FloatArray:
    """Integral of (z - h) phi(z) from h on."""
    return np.asarray(_density(h) - h * special.ndtr(-h), dtype=np.float64)
