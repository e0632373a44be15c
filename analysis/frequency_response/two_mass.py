"""Eq. 9 fitted to frequency responses: k_c, c_c, and the masses and springs that the channels identify.

The accelerance of Eq. 9 for a force on the upper mass, with a damper c beside each tube spring, is

    A_2 / F = s^2 (k_c + c_c s) / D,    A_1 / F = s^2 (m2 s^2 + c s + k2 + k_c + c_c s) / D,
    D = (m1 s^2 + c s + k1 + k_c + c_c s) (m2 s^2 + c s + k2 + k_c + c_c s) - (k_c + c_c s)^2.

What they identify: of both modes of A_2 / F the residues are 1 / (m1 + m2) but for the springs' unequal share, so the
transfer response alone tells the sum of the masses, and k_c (1/m1 + 1/m2) by f2; k_c itself follows with the *ratio* of
the masses, which has to be known (where they are nearly equal hardly: k_c changes with the square of its error). The
response of the struck mass itself tends to 1/m1 and tells it alone; both together tell m1, m2 and k_c.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from analysis.frequency_response.estimators import ForceError, Spectra, estimators, laplace
from calibration.estimate import Estimate
from rig.tube import OwnMode

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

FEWEST_REPEATS = 3
"""Hits from which the scatter between them says how uncertain a fit is (by leaving out one at a time)."""

FEWEST_LINES = 12

METHOD_ERROR = 5e-4
"""Relative standard uncertainty for what windows and sampling do to masses and stiffness: over 200 simulated loads k_c
came out 2e-4 too high on average (`tests/analysis/frequency_response/test_two_mass.py`)."""

CONVERGED = 1e-10
STEP = 1e-6
LARGEST_LOGARITHM = 3.0
"""Of a mass or spring over where the fit begins: a factor of 20 holds a sensitivity in the wrong unit (4.448)."""

LARGEST_DAMPING = 1.0
"""Of critical, by which a damper may depart from where the fit begins."""

UPPER, LOWER = 0, 1


@dataclass(frozen=True, slots=True)
class TwoMassModel:
    """Masses (kg), tube springs (N/m), contact (N/m, N s/m), a damper beside each spring (N s/m), tubes' own mode."""

    m1: float
    m2: float
    k1: float
    k2: float
    kc: float
    cc: float
    c: float = 0.0
    tube_mode: OwnMode | None = None

    def accelerance(self, s: Complex, struck: int = UPPER, seen: int = LOWER) -> Complex:
        """Return acceleration of a mass over the force on one, 1/kg, at s, (k,)."""
        own: Complex | float = 0.0
        if self.tube_mode is not None:  # its mass times x / (1 - x), x = (f / f0)^2
            x = -(s**2) / (2 * math.pi * self.tube_mode.frequency_hz) ** 2
            own = self.tube_mode.mass_kg * x / (1 - x) * s**2
        contact = self.kc + self.cc * s
        upper = self.m1 * s**2 + self.c * s + self.k1 + own + contact
        lower = self.m2 * s**2 + self.c * s + self.k2 + own + contact
        above = contact if struck != seen else (lower if struck == UPPER else upper)
        return np.asarray(s**2 * above / (upper * lower - contact**2), np.complex128)


@dataclass(frozen=True, slots=True)
class Seen:
    """Which response of the spectra is the acceleration of which mass, and which mass is struck."""

    row: int
    mass: int
    struck: int = UPPER


@dataclass(frozen=True, slots=True)
class TwoMassFit:
    """Eq. 9 as frequency responses give it.

    Attributes
    ----------
    contact_stiffness, contact_damping
        k_c, N/m, and c_c, N s/m.
    mass_sum, spring_sum
        m1 + m2, kg, and k1 + k2, N/m.
    upper_mass, lower_mass
        kg; None where the channels do not tell one from the other.
    model
        The fitted rig.
    not_identified
        What the channels do not tell, and what was taken instead; one sentence, empty if nothing.
    misfit
        Root mean square of model minus H1 over that of H1, both weighted with the force spectrum.
    repeats
        Hits behind it.
    """

    contact_stiffness: Estimate
    contact_damping: Estimate
    mass_sum: Estimate
    spring_sum: Estimate
    upper_mass: Estimate | None
    lower_mass: Estimate | None
    model: TwoMassModel
    not_identified: str
    misfit: float
    repeats: int


RATIO_UNKNOWN = (
    "the transfer response does not tell the upper mass from the lower one, only their sum: their ratio is the "
    "declared one; nor k1 from k2, only their sum"
)
SPRINGS_UNKNOWN = "the responses hardly tell k1 from k2, only their sum: their ratio is the declared one"


def fit_two_mass(
    spectra: Spectra,
    frequency_hz: Real,
    seen: Sequence[Seen],
    start: TwoMassModel,
    band_hz: tuple[float, float],
    decay_per_s: float = 0.0,
    scale_error: float = 0.0,
    ratio_error: float = 0.0,
) -> TwoMassFit:
    """Fit Eq. 9 to H1, weighted with the force spectrum (white noise of the responses).

    Parameters
    ----------
    spectra, frequency_hz
        Transforms of all hits, and their lines, Hz.
    seen
        Which responses are the accelerations of which mass. With one of the struck mass among them both masses are
        fitted; else their sum, with the ratio of ``start``.
    start
        Where the fit begins; the ratios of masses and springs, and the tubes' own mode, are taken from it.
    band_hz
        Lines that are fitted.
    decay_per_s
        Of the exponential window.
    scale_error
        Relative standard uncertainty of response over force by the sensitivities: it is that of all masses, springs and
        of k_c and c_c.
    ratio_error
        Standard uncertainty of m1 / (m1 + m2) where that is not fitted.

    Raises
    ------
    ForceError
        Too few lines, or no model is anywhere near.
    """
    inside = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    if inside.sum() < FEWEST_LINES:
        raise ForceError(
            f"only {int(inside.sum())} lines lie between {band_hz[0]:.0f} and {band_hz[1]:.0f} Hz, where the hammer "
            "excites: too few to fit Eq. 9; use a harder tip, or a longer record"
        )
    s = laplace(frequency_hz[inside], decay_per_s)
    cut = Spectra(spectra.force[:, inside], spectra.response[..., inside])
    both = any(view.mass == view.struck for view in seen)
    best, misfit = _fitted(cut, s, seen, start, both)
    repeats = len(cut.force)
    values = _numbers(best)
    if repeats >= FEWEST_REPEATS:
        each = np.array([_numbers(_fitted(cut.without(i), s, seen, best, both)[0]) for i in range(repeats)])
        errors = np.sqrt((repeats - 1) / repeats * ((each - each.mean(axis=0)) ** 2).sum(axis=0))
        dof = repeats - 1.0
    else:
        errors, dof = _errors_of_one(cut, s, seen, best, both), math.inf
    share = best.m1 / (best.m1 + best.m2)
    of_ratio = 0.0 if both else ratio_error * abs(1 - 2 * share) / (share * (1 - share))
    by_ratio = dict.fromkeys(("kc", "cc"), of_ratio)
    found = {
        name: _estimate(value, float(error), dof, math.hypot(scale_error, METHOD_ERROR, by_ratio.get(name, 0.0)))
        for name, value, error in zip(_NAMES, values, errors, strict=True)
    }
    return TwoMassFit(
        contact_stiffness=found["kc"],
        contact_damping=found["cc"],
        mass_sum=found["sum"],
        spring_sum=found["springs"],
        upper_mass=found["m1"] if both else None,
        lower_mass=found["m2"] if both else None,
        model=best,
        not_identified=SPRINGS_UNKNOWN if both else RATIO_UNKNOWN,
        misfit=misfit,
        repeats=repeats,
    )


_NAMES = ("kc", "cc", "sum", "springs", "m1", "m2")


def _numbers(model: TwoMassModel) -> tuple[float, ...]:
    return (model.kc, model.cc, model.m1 + model.m2, model.k1 + model.k2, model.m1, model.m2)


def _estimate(value: float, random: float, dof: float, relative: float) -> Estimate:
    """Return a value with its random error and a known relative one; degrees of freedom by Welch and Satterthwaite."""
    known = relative * abs(value)
    total = math.hypot(random, known)
    effective = math.inf if random == 0 or math.isinf(dof) else dof * (total / random) ** 4
    return Estimate(value, total, effective)


def _scaled(x: Real, start: TwoMassModel, both: bool) -> TwoMassModel:
    """Return the model of free parameters, (n,): logarithms of ratios to ``start``, dampers by their critical ones."""
    e = np.exp(x[:3])
    masses = (e[0], float(np.exp(x[5])) if both else e[0])
    m1, m2 = start.m1 * masses[0], start.m2 * masses[1]
    kc = start.kc * e[2]
    critical = 2 * math.sqrt(start.kc * start.m1 * start.m2 / (start.m1 + start.m2))
    of_tubes = 2 * math.sqrt((start.k1 + start.k2) * (start.m1 + start.m2)) / 2
    return replace(
        start,
        m1=float(m1),
        m2=float(m2),
        k1=float(start.k1 * e[1]),
        k2=float(start.k2 * e[1]),
        kc=float(kc),
        cc=float(start.cc + critical * x[3]),
        c=float(start.c + of_tubes * x[4]),
    )


@dataclass(frozen=True, slots=True)
class _Fit:
    """What is fitted: H1 of each view times the weight, (v, k), at s, by a model begun from ``start``."""

    measured: Complex
    weight: Real
    s: Complex
    seen: tuple[Seen, ...]
    start: TwoMassModel
    both: bool

    @classmethod
    def of(cls, cut: Spectra, s: Complex, seen: Sequence[Seen], start: TwoMassModel, both: bool) -> _Fit:
        h1, weight = estimators(cut)[0], np.sqrt(cut.force_power)
        weight = weight / np.sqrt(np.mean(np.abs(h1[[v.row for v in seen]] * weight) ** 2))
        return cls(h1[[v.row for v in seen]] * weight, weight, s, tuple(seen), start, both)

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return 6 if self.both else 5

    def residuals(self, x: Real) -> Real:
        """Return measured minus model, real and imaginary parts, (2 v k,)."""
        model = _scaled(x, self.start, self.both)
        left = self.measured - self.weight * np.array([model.accelerance(self.s, v.struck, v.mass) for v in self.seen])
        return np.concatenate([left.real.ravel(), left.imag.ravel()])


def _fitted(
    cut: Spectra, s: Complex, seen: Sequence[Seen], start: TwoMassModel, both: bool
) -> tuple[TwoMassModel, float]:
    """Return the model that fits best, and what it leaves over, relative."""
    fit = _Fit.of(cut, s, seen, start, both)
    limit = np.where(np.isin(np.arange(fit.size), (3, 4)), LARGEST_DAMPING, LARGEST_LOGARITHM)
    found = least_squares(
        fit.residuals, np.zeros(fit.size), bounds=(-limit, limit), x_scale="jac", xtol=CONVERGED, ftol=CONVERGED
    )
    return _scaled(found.x, start, both), float(np.sqrt(2 * found.cost / fit.measured.size))


def _errors_of_one(cut: Spectra, s: Complex, seen: Sequence[Seen], best: TwoMassModel, both: bool) -> Real:
    """Standard errors from the residual alone, (6,): what differs from hit to hit is not in it."""
    fit = _Fit.of(cut, s, seen, best, both)
    steps = STEP * np.eye(fit.size)
    base = fit.residuals(np.zeros(fit.size))
    jacobian = np.array([(fit.residuals(h) - base) / STEP for h in steps]).T
    variance = float(base @ base) / max(1, base.size - fit.size)
    covariance = variance * np.linalg.pinv(jacobian.T @ jacobian)
    reference = np.array(_numbers(best))
    gradient = np.array([(np.array(_numbers(_scaled(h, best, both))) - reference) / STEP for h in steps])
    return np.asarray(np.sqrt(np.einsum("pi,pq,qi->i", gradient, covariance, gradient)), np.float64)
