"""Contact force against approach, about a preload: compiled laws, each a number and a few lines.

About the preload P a law has the tangent stiffness k, whatever its shape:

linear        P + k d
hertz         P (1 + k d / (1.5 P))^1.5, zero beyond the separation d = -1.5 P / k: C delta^1.5 with both constants
              expressed by P = C delta0^1.5 and k = 1.5 P / delta0
exponential   P exp(k d / P): dP/d delta grows as P itself; never separates by itself

Beside it acts the damping c times the approach rate. A contact that can part knows no tension: elastic and damping
force together vanish where their sum would pull, or where the surfaces are apart. One that cannot part keeps its
damping at all times.

So that the integrator always sees a smooth force, a contact is either ``touching`` or not, and `margin` is positive
as long as it stays what it is.

The integrator's machine code contains these functions and is kept on disk by the date of integrator.py alone: after
a change here, touch that file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

LINEAR, HERTZ, EXPONENTIAL = 0, 1, 2
LAW_NUMBER = {"linear": LINEAR, "hertz": HERTZ, "exponential": EXPONENTIAL}
PRELOAD, STIFFNESS, DAMPING, CAN_PART = range(4)  # places in the parameter vector


@dataclass(frozen=True, slots=True)
class ContactLaw:
    """A force law about its preload.

    Attributes
    ----------
    law
        Which shape.
    preload
        P, N, above zero.
    can_part
        Whether tension is impossible.
    """

    law: Literal["linear", "hertz", "exponential"]
    preload: float
    can_part: bool = False

    @property
    def number(self) -> int:
        """Number of the compiled law."""
        return LAW_NUMBER[self.law]

    def parameters(self, stiffness: float, damping: float) -> NDArray[np.float64]:
        """Return the compiled law's parameter vector (4,) for k (N/m) and c (N s/m) at the preload."""
        return np.array([self.preload, stiffness, damping, float(self.can_part)])


@njit(cache=True)
def elastic(law: int, p: NDArray[np.float64], d: float) -> tuple[float, float]:
    """Return the elastic part of the force less the preload, N, and its slope, N/m.

    Smooth for every d: beyond separation the Hertz law goes on as an odd function, which lets a step that
    overshoots the separation be brought back to it.
    """
    if law == HERTZ:
        u = 1 + p[STIFFNESS] * d / (1.5 * p[PRELOAD])
        root = math.sqrt(abs(u))
        if u > 0.5:
            return p[PRELOAD] * math.expm1(1.5 * math.log(u)), p[STIFFNESS] * root
        return p[PRELOAD] * (u * root - 1), p[STIFFNESS] * root
    if law == EXPONENTIAL:
        x = min(p[STIFFNESS] * d / p[PRELOAD], 500.0)
        return p[PRELOAD] * math.expm1(x), p[STIFFNESS] * math.exp(x)
    return p[STIFFNESS] * d, p[STIFFNESS]


@njit(cache=True)
def dynamic_force(law: int, p: NDArray[np.float64], touching: bool, d: float, rate: float) -> float:
    """Return the contact force less the preload, N, for approach ``d`` (m) and its rate (m/s)."""
    if touching:
        return elastic(law, p, d)[0] + p[DAMPING] * rate
    if p[CAN_PART] > 0:
        return -p[PRELOAD]
    return -p[PRELOAD] + p[DAMPING] * rate


@njit(cache=True)
def margin(
    law: int, p: NDArray[np.float64], touching: bool, d: float, rate: float, acceleration: float
) -> tuple[float, float]:
    """Return how far the contact is from becoming (not) touching, N, and the time derivative of that, N/s."""
    parts = p[CAN_PART] > 0
    if not parts and law != HERTZ:
        return 1.0, 0.0
    force, slope = elastic(law, p, d)
    total = p[PRELOAD] + force
    total_rate = slope * rate
    # the surfaces' overlap in units of force; the exponential law has no end to it
    overlap, overlap_rate = math.inf, 0.0
    if law == LINEAR:
        overlap, overlap_rate = total, total_rate
    elif law == HERTZ:
        overlap, overlap_rate = p[PRELOAD] + p[STIFFNESS] * d / 1.5, p[STIFFNESS] * rate / 1.5
    if parts:
        total += p[DAMPING] * rate
        total_rate += p[DAMPING] * acceleration
    else:
        total, total_rate = overlap, overlap_rate
    if touching:
        return total, total_rate
    if overlap < total:
        return -overlap, -overlap_rate
    return -total, -total_rate
