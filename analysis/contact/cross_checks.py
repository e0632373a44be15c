"""Other ways to a contact stiffness or a roughness, which a laboratory can hold against the contact resonance.

Roughness from the stiffness (Hess and Wagh 1995), stiffness from load against approach, and stiffness from the
ultrasound that an interface reflects (Dwyer-Joyce, Drinkwater and Quinn 2001): the paper's references 12, 16 and 14.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, stats

from analysis.contact import gaussian
from analysis.contact.exponential import LAMBDA
from analysis.contact.inversion import TheoryError
from calibration.estimate import Estimate

FloatArray = NDArray[np.float64]
ROUGHNESS_RANGE = (1e-10, 1e-3)  # m


def roughness_from_stiffness(P: ArrayLike, k_c: ArrayLike) -> FloatArray:
    """Return R_q, m, of flats with exponential heights (Eq. 8): lambda P / k_c, the shape of both together.

    Parameters
    ----------
    P, k_c
        Load, N, and contact stiffness, N/m, as from Eq. 11.

    Examples
    --------
    >>> roughness_from_stiffness([1.0, 2.0], [1e6, 2e6])
    array([3.e-06, 3.e-06])
    """
    load, stiffness = np.asarray(P, dtype=np.float64), np.asarray(k_c, dtype=np.float64)
    if not ((load > 0).all() and (stiffness > 0).all()):
        raise TheoryError("roughness follows from a load and a contact stiffness above zero")
    return np.asarray(LAMBDA * load / stiffness, dtype=np.float64)


def gaussian_roughness_from_stiffness(
    P: float, k_c: Estimate, eta: float, A_n: float, E_star: float, R_s: float
) -> Estimate:
    """Return R_q, m, of flats with Gaussian heights (Eq. 5) whose stiffness at the load ``P``, N, is ``k_c``, N/m.

    eta in 1/m2, A_n in m2, E* in Pa, R_s in m. The interval is that of the stiffness, first order.
    """

    def stiffness(R_q: float) -> float:
        return float(gaussian.stiffness(P, eta, A_n, E_star, R_s, R_q))

    def excess(log_R_q: float) -> float:
        try:
            return math.log(stiffness(math.exp(log_R_q)) / k_c.value)
        except TheoryError:  # so smooth that all asperities are flattened: as stiff as can be
            return math.inf

    low, high = (math.log(r) for r in ROUGHNESS_RANGE)
    while math.isinf(excess(low)) and low < high:
        low += 0.1
    if not (P > 0 and k_c.value > 0) or excess(low) * excess(high) > 0:
        raise TheoryError(f"no roughness gives {k_c.value:.3g} N/m at {P:g} N with these asperities")
    R_q = math.exp(float(optimize.brentq(excess, low, high, xtol=1e-12)))
    step = 1e-4
    slope = math.log(stiffness(R_q * (1 + step)) / stiffness(R_q * (1 - step))) / (2 * step)
    return Estimate(R_q, abs(R_q / slope) * k_c.standard_error / k_c.value, k_c.dof)


def stiffness_from_approach(approach: ArrayLike, load: ArrayLike, at: float, width: float) -> Estimate:
    """Return the slope of load against approach at a load, N/m.

    A parabola through the points whose loads lie within ``width`` of ``at``, for the contact stiffens; its slope
    where it carries the load ``at``.

    Parameters
    ----------
    approach, load
        (n,) m and N.
    at, width
        Load at which the slope is wanted and half of the window, N.

    Examples
    --------
    >>> import numpy as np
    >>> delta = np.linspace(0, 1e-6, 50)
    >>> found = stiffness_from_approach(delta, 1e6 * delta, at=0.5, width=0.1)
    >>> f"{found.value:.4g}"
    '1e+06'
    """
    x, P = np.asarray(approach, dtype=np.float64), np.asarray(load, dtype=np.float64)
    inside = np.abs(P - at) <= width
    if inside.sum() < 5 or len(np.unique(x[inside])) < 4:
        raise TheoryError(f"{int(inside.sum())} points within {width:g} N of {at:g} N are too few for a slope")
    x, P = x[inside], P[inside]
    # load as the abscissa: a known load is asked for, and x(P) is the straighter of the two
    u = (P - at) / width
    basis = np.stack([np.ones_like(u), u, u**2], axis=1)
    coefficients, *_ = np.linalg.lstsq(basis, x - x.mean(), rcond=None)
    dof = len(u) - 3
    variance = float(np.sum((x - x.mean() - basis @ coefficients) ** 2)) / dof
    error = math.sqrt(variance * float(np.linalg.inv(basis.T @ basis)[1, 1]))
    slope = float(coefficients[1]) / width
    if slope <= 0:
        raise TheoryError(f"the load does not grow with the approach at {at:g} N")
    return Estimate(1 / slope, error / width / slope**2, dof)


def reflection_coefficient(k: ArrayLike, f_hz: ArrayLike, z_1: float, z_2: float) -> FloatArray:
    """Return the magnitude of the reflection coefficient of an interface that is a spring without mass.

    R = (z_1 - z_2 + i omega z_1 z_2 / K) / (z_1 + z_2 + i omega z_1 z_2 / K).

    Parameters
    ----------
    k
        (...) stiffness per area K, N/m3.
    f_hz
        (...) frequency.
    z_1, z_2
        Acoustic impedances, density times wave speed, of both bodies, kg/(m2 s).

    Examples
    --------
    >>> round(float(reflection_coefficient(1e30, 1e6, 46e6, 17e6)), 3)  # perfect contact: 29 / 63
    0.46
    >>> round(float(reflection_coefficient(1e3, 1e6, 46e6, 17e6)), 3)  # no contact
    1.0
    """
    term = 2 * np.pi * np.asarray(f_hz, dtype=np.float64) * z_1 * z_2 / np.asarray(k, dtype=np.float64)
    return np.asarray(np.abs((z_1 - z_2 + 1j * term) / (z_1 + z_2 + 1j * term)), dtype=np.float64)


def stiffness_from_reflection(reflection: ArrayLike, f_hz: ArrayLike, z_1: float, z_2: float, A_n: float) -> Estimate:
    """Return the contact stiffness, N/m, of an interface of area ``A_n``, m2, from the ultrasound that it reflects.

    Least squares over the spectrum, the reflection coefficient equally uncertain at every frequency.

    Parameters
    ----------
    reflection
        (n,) magnitude of the reflection coefficient: spectrum of the echo over that of a free surface.
    f_hz
        (n,) frequencies, Hz; two at least for an interval.
    z_1, z_2
        Acoustic impedances, kg/(m2 s).
    A_n
        Nominal area, m2.

    Examples
    --------
    >>> import numpy as np
    >>> f = np.linspace(1e6, 5e6, 20)
    >>> found = stiffness_from_reflection(reflection_coefficient(1e13, f, 46e6, 46e6), f, 46e6, 46e6, A_n=1e-6)
    >>> f"{found.value:.4g}"
    '1e+07'
    """
    R, f = (np.atleast_1d(np.asarray(a, dtype=np.float64)) for a in (reflection, f_hz))
    lowest = abs(z_1 - z_2) / (z_1 + z_2)  # of surfaces in perfect contact
    usable = (lowest < R) & (R < 1) & (f > 0)
    if not usable.any():
        raise TheoryError(
            f"no reflection coefficient lies between {lowest:.3g}, perfect contact, and 1, no contact: "
            "no stiffness follows"
        )
    inside, omega = R[usable], 2 * np.pi * f[usable]
    term = np.sqrt((inside**2 * (z_1 + z_2) ** 2 - (z_1 - z_2) ** 2) / (1 - inside**2))
    start = float(np.median(np.log(omega * z_1 * z_2 / term)))

    def residual(log_k: FloatArray) -> FloatArray:
        return reflection_coefficient(np.exp(log_k[0]), f, z_1, z_2) - R

    fit = optimize.least_squares(residual, [start], x_scale=0.1)
    dof = len(R) - 1
    variance = 2 * fit.cost / dof if dof else math.nan
    value = math.exp(float(fit.x[0])) * A_n
    slope = np.asarray(fit.jac).ravel()
    return Estimate(value, value * math.sqrt(variance / float(slope @ slope)), float(max(dof, 1)))


def mean_roughness(P: ArrayLike, k_c: ArrayLike) -> Estimate:
    """Return one R_q, m, from stiffnesses at several loads, (n,) each: the mean logarithm of Eq. 8."""
    log_R_q = np.log(roughness_from_stiffness(P, k_c))
    value = math.exp(float(log_R_q.mean()))
    return Estimate(value, value * float(stats.sem(log_R_q)), len(log_R_q) - 1)
