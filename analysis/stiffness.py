"""Contact stiffness and damping from the resonances of the tester (Sec. 3.4, Eq. 9 to 11).

The tester is two masses on tube springs, in contact through k_c and c_c (Eq. 9). With s a root of its
characteristic equation (Eq. 10, in s = j omega),

    (m1 s^2 + k1) (m2 s^2 + k2) + (k_c + c_c s) ((m1 + m2) s^2 + k1 + k2) = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.estimate import Estimate
from rig.errors import MesotapError

FloatArray = NDArray[np.float64]
RING = math.pi / 4 - 2 / math.pi  # thin ring pressed across a diameter: deflection RING * F R^3 / (E I); 0.1488


class ResonanceError(MesotapError, ValueError):
    """These resonances, masses and springs do not belong together in Eq. 10; the text is one sentence."""


def contact_stiffness(f2_hz: ArrayLike, m1: float, m2: float, k1: float, k2: float) -> FloatArray:
    """Contact stiffness from the contact resonance without damping, the real part of Eq. 11, N/m.

    Parameters
    ----------
    f2_hz
        (...) contact resonance, Hz.
    m1, m2
        Masses, kg.
    k1, k2
        Tube springs, N/m.

    Returns
    -------
    NDArray
        Shaped like ``f2_hz``.

    Raises
    ------
    ResonanceError
        A resonance at or below the system resonance: there Eq. 11 has a pole or turns negative.

    Examples
    --------
    >>> k = contact_stiffness(2000.0, m1=0.1, m2=0.1, k1=1e6, k2=1e6)
    >>> f"{float(k):.4g}"
    '7.396e+06'
    """
    _check_tester(m1, m2, k1, k2)
    frequency = np.asarray(f2_hz, dtype=np.float64)
    w = (2 * np.pi * frequency) ** 2
    wrong = ~(w > max(k1 / m1, k2 / m2, (k1 + k2) / (m1 + m2)))
    if wrong.any():
        raise ResonanceError(_below_system_mode(float(frequency[wrong].flat[0]), m1, m2, k1, k2))
    return np.asarray((m1 * w - k1) * (m2 * w - k2) / ((m1 + m2) * w - (k1 + k2)), dtype=np.float64)


def pole(f_hz: float, zeta: float) -> complex:
    """Root s (rad/s, upper half plane) with abs(s) / 2 pi = ``f_hz`` and -Re s / abs(s) = ``zeta``."""
    if not (f_hz > 0 and math.isfinite(f_hz) and -1 < zeta < 1):
        raise ResonanceError(f"{f_hz:g} Hz with damping ratio {zeta:g} is not an oscillation")
    return 2 * math.pi * f_hz * complex(-zeta, math.sqrt(1 - zeta**2))


def contact_from_pole(s: complex, m1: float, m2: float, k1: float, k2: float) -> tuple[float, float]:
    """Contact stiffness, N/m, and damping, N s/m, both real, that put a root of Eq. 10 exactly at ``s``.

    Eq. 10 is one complex equation, so that one complex root gives both. Eq. 11 with the imaginary part left out is its
    limit for light damping.

    Parameters
    ----------
    s
        Root, rad/s; Im s > 0.
    m1, m2, k1, k2
        kg and N/m.

    Raises
    ------
    ResonanceError
        No oscillation, at or below the system resonance, or a pole that only a negative stiffness could give.

    Examples
    --------
    >>> k, c = contact_from_pole(-100 + 12_000j, m1=0.1, m2=0.1, k1=1e6, k2=1e6)
    >>> f"{k:.4g}", f"{c:.3g}"
    ('6.7e+06', '10')
    """
    contact = _contact(s, m1, m2, k1, k2)
    return contact.k_c, contact.c_c


@dataclass(frozen=True, slots=True)
class ContactEstimate:
    """Contact stiffness and damping with their uncertainty.

    Attributes
    ----------
    stiffness_n_per_m, damping_n_s_per_m
        Estimates of k_c and c_c.
    covariance
        (2, 2) of k_c and c_c.
    gradient
        (2, 6) of k_c and c_c by f2 (Hz), zeta2, m1, m2 (kg), k1, k2 (N/m).
    """

    stiffness_n_per_m: Estimate
    damping_n_s_per_m: Estimate
    covariance: FloatArray
    gradient: FloatArray


def contact_gradient(
    f2_hz: float, zeta2: float, m1: float, m2: float, k1: float, k2: float
) -> tuple[float, float, FloatArray]:
    """Contact stiffness and damping, and their (2, 6) derivatives by the six arguments in their order.

    The derivatives follow from Eq. 10 by implicit differentiation.
    """
    s = pole(f2_hz, zeta2)
    contact = _contact(s, m1, m2, k1, k2)
    A, B, D, Z = contact.A, contact.B, contact.D, contact.Z
    Z_by_s = -2 * s * (m1 * (B + Z) + m2 * (A + Z)) / D
    s_by_zeta = 2 * math.pi * f2_hz * complex(-1, -zeta2 / math.sqrt(1 - zeta2**2))
    ds = np.array([s / f2_hz, s_by_zeta, 0, 0, 0, 0])
    by_parameter = [0, 0, s**2 * (B + Z), s**2 * (A + Z), B + Z, A + Z]
    dZ = Z_by_s * ds - np.array(by_parameter) / D
    dc = (dZ.imag - contact.c_c * ds.imag) / s.imag
    dk = dZ.real - dc * s.real - contact.c_c * ds.real
    return contact.k_c, contact.c_c, np.stack([dk, dc])


def contact_estimate(
    f2_hz: Estimate,
    zeta2: Estimate,
    m1: Estimate,
    m2: Estimate,
    k1: Estimate,
    k2: Estimate,
    covariance: FloatArray | None = None,
) -> ContactEstimate:
    """Contact stiffness and damping with the uncertainty of everything they are made of.

    First order in the uncertainties, with degrees of freedom after Welch and Satterthwaite.

    Parameters
    ----------
    f2_hz, zeta2, m1, m2, k1, k2
        Contact mode, Hz and 1; masses, kg; tube springs, N/m.
    covariance
        (6, 6) of the six; default independent. The standard errors are those of the estimates in any case: only
        the correlations are read from it.
    """
    inputs = (f2_hz, zeta2, m1, m2, k1, k2)
    k_c, c_c, gradient = contact_gradient(*(x.value for x in inputs))
    errors = np.array([x.standard_error for x in inputs])
    correlation = np.eye(6) if covariance is None else _correlation(np.asarray(covariance, dtype=np.float64))
    spread = gradient * errors
    total = spread @ correlation @ spread.T
    dof = [_welch_satterthwaite(float(total[i, i]), spread[i] ** 2, [x.dof for x in inputs]) for i in range(2)]
    return ContactEstimate(
        Estimate(k_c, math.sqrt(max(total[0, 0], 0.0)), dof[0]),
        Estimate(c_c, math.sqrt(max(total[1, 1], 0.0)), dof[1]),
        total,
        gradient,
    )


def springs_from_system_mode(f1_hz: float, k_c: float, m1: float, m2: float, ratio: float = 1.0) -> tuple[float, float]:
    """Tube springs k1 and k2 = ``ratio`` k1 that put the system mode at ``f1_hz``, N/m.

    With an infinitely stiff contact, k1 + k2 = (m1 + m2) omega1^2. With a finite one Eq. 10 is a quadratic equation in
    k1 whose larger root belongs to the lower mode. With m1 near m2 and k1 near k2 the masses move together in this
    mode and k_c hardly matters.

    Parameters
    ----------
    f1_hz
        System resonance (lower mode), Hz.
    k_c
        Contact stiffness, N/m; may be infinite.
    m1, m2
        kg.
    ratio
        k2 / k1.

    Examples
    --------
    >>> import math
    >>> k1, k2 = springs_from_system_mode(500.0, math.inf, m1=0.1, m2=0.1)
    >>> round(k1 + k2) == round(0.2 * (2 * math.pi * 500) ** 2)
    True
    """
    if not (f1_hz > 0 and math.isfinite(f1_hz) and m1 > 0 and m2 > 0 and ratio > 0 and k_c >= 0):
        raise ResonanceError(
            f"no springs belong to a system resonance of {f1_hz:g} Hz with masses {m1:g} and {m2:g} kg, "
            f"k2 / k1 = {ratio:g} and k_c = {k_c:g} N/m: all must be positive"
        )
    w = (2 * math.pi * f1_hz) ** 2
    if math.isinf(k_c):
        k1 = (m1 + m2) * w / (1 + ratio)
        return k1, ratio * k1
    # ratio k1^2 + b k1 + c = 0
    b = (1 + ratio) * k_c - (m2 + ratio * m1) * w
    c = m1 * m2 * w**2 - (m1 + m2) * w * k_c
    root = math.sqrt(b**2 - 4 * ratio * c)
    k1 = -2 * c / (b + root) if b > 0 else (root - b) / (2 * ratio)
    return k1, ratio * k1


def ring_spring_stiffness(E: float, L: float, t: float, R: float) -> float:
    """Stiffness of a short tube pressed across its diameter, N/m: a thin ring, k = E I / (0.1488 R^3), I = L t^3 / 12.

    Parameters
    ----------
    E
        Young's modulus, Pa.
    L, t, R
        Length, wall and mean radius, m. 30, 0.5 and 9.25 mm in Sec. 3.1.

    Examples
    --------
    >>> f"{ring_spring_stiffness(E=2.1e11, L=30e-3, t=0.5e-3, R=9.25e-3):.3g}"
    '5.57e+05'
    """
    return E * L * t**3 / 12 / (RING * R**3)


@dataclass(frozen=True, slots=True)
class _Contact:
    """A solved Eq. 10: A = m1 s^2 + k1, B = m2 s^2 + k2, D = A + B, Z = k_c + c_c s = -A B / D."""

    A: complex
    B: complex
    D: complex
    Z: complex
    k_c: float
    c_c: float


def _contact(s: complex, m1: float, m2: float, k1: float, k2: float) -> _Contact:
    _check_tester(m1, m2, k1, k2)
    if not (math.isfinite(s.real) and math.isfinite(s.imag) and s.imag > 0):
        raise ResonanceError(f"the pole {s:.6g} rad/s is not an oscillation")
    if abs(s) ** 2 <= (k1 + k2) / (m1 + m2):
        raise ResonanceError(_below_system_mode(abs(s) / (2 * math.pi), m1, m2, k1, k2))
    A, B = m1 * s**2 + k1, m2 * s**2 + k2
    Z = -A * B / (A + B)
    c_c = Z.imag / s.imag
    k_c = Z.real - c_c * s.real
    if not k_c > 0:
        raise ResonanceError(
            f"a mode at {abs(s) / (2 * math.pi):.1f} Hz with damping ratio {-s.real / abs(s):.3f} would need a "
            f"negative contact stiffness ({k_c:.3g} N/m): it is not the contact mode of these masses and springs"
        )
    return _Contact(A, B, A + B, Z, k_c, c_c)


def _check_tester(m1: float, m2: float, k1: float, k2: float) -> None:
    for name, value in (("m1", m1), ("m2", m2)):
        if not (value > 0 and math.isfinite(value)):
            raise ResonanceError(f"mass {name} = {value:g} kg must be positive")
    for name, value in (("k1", k1), ("k2", k2)):
        if not (value >= 0 and math.isfinite(value)):
            raise ResonanceError(f"tube spring {name} = {value:g} N/m must not be negative")


def _below_system_mode(f_hz: float, m1: float, m2: float, k1: float, k2: float) -> str:
    limit = math.sqrt(max(k1 / m1, k2 / m2, (k1 + k2) / (m1 + m2))) / (2 * math.pi)
    return (
        f"a contact resonance of {f_hz:.1f} Hz is not above the system resonance, which these masses and springs put "
        f"near {limit:.1f} Hz: Eq. 11 has no contact stiffness for it; check which mode it is, and the springs"
    )


def _correlation(covariance: FloatArray) -> FloatArray:
    if covariance.shape != (6, 6):
        raise ValueError(f"a covariance of f2, zeta2, m1, m2, k1, k2 is (6, 6), not {covariance.shape}")
    std = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(np.where(std > 0, std, 1.0), np.where(std > 0, std, 1.0))
    np.fill_diagonal(correlation, 1.0)
    return correlation


def _welch_satterthwaite(total: float, parts: FloatArray, dofs: list[float]) -> float:
    uncertain = sum(float(part) ** 2 / dof for part, dof in zip(parts, dofs, strict=True))
    return max(total**2 / uncertain, 1.0) if uncertain > 0 and total > 0 else math.inf
