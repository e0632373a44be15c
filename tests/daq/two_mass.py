"""An exact two-mass tester for the tests of this package: Eq. 9 in state space, solved mode by mode.

The solution is exact for a force that is linear between samples; it is sampled eight times as finely as the record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

FINER = 8


@dataclass(frozen=True)
class TwoMass:
    """Masses kg, springs N/m, contact stiffness N/m, dampers N s/m."""

    k_c: float = 5e6
    c_c: float = 5.0
    m1: float = 0.107
    m2: float = 0.108
    k: float = 0.5379e6
    c: float = 1.0

    @classmethod
    def damped(cls, k_c: float, zeta_c: float, zeta_s: float = 0.003) -> TwoMass:
        reduced = 0.107 * 0.108 / 0.215
        omega_c = np.sqrt(k_c / reduced)
        omega_s = np.sqrt(2 * 0.5379e6 / 0.215)
        return cls(k_c=k_c, c_c=2 * zeta_c * omega_c * reduced, c=2 * zeta_s * omega_s * 0.215 / 2)

    def state_space(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Input: force on m1, N. Outputs: a2 (m/s2) and contact force k_c (x1 - x2) + c_c (v1 - v2), N."""
        stiffness = np.array([[self.k_c + self.k, -self.k_c], [-self.k_c, self.k_c + self.k]])
        damping = np.array([[self.c_c + self.c, -self.c_c], [-self.c_c, self.c_c + self.c]])
        inverse = np.diag([1 / self.m1, 1 / self.m2])
        a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
        b = np.array([[0.0], [0.0], [1 / self.m1], [0.0]])
        c = np.vstack([a[3], [self.k_c, -self.k_c, self.c_c, -self.c_c]])
        return a, b, c, np.zeros((2, 1))


def tap(
    tester: TwoMass,
    impacts: list[tuple[float, float]],
    pulse_s: float = 4e-4,
    samples: int = 2500,
    pretrigger: int = 250,
    rate: float = 25000.0,
    filtered: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return a2 (n,) and contact force (n,) of half-sine impacts given as (seconds after the first, peak in N)."""
    t = np.arange(samples * FINER) / (rate * FINER)
    force = np.zeros_like(t)
    for delay, peak in impacts:
        since = t - pretrigger / rate - delay
        force += np.where((since > 0) & (since < pulse_s), peak * np.sin(np.pi * since / pulse_s), 0.0)
    a, b, c, _ = tester.state_space()
    if filtered:
        for order, corner, kind in ((1, 10.0, "highpass"), (4, 10000.0, "lowpass")):
            numerator, denominator = signal.butter(order, 2 * np.pi * corner, kind, analog=True)
            fa, fb, fc, fd = signal.tf2ss(numerator, denominator)
            a = np.block([[a, np.zeros((len(a), order))], [fb @ c[:1], fa]])
            b = np.vstack([b, np.zeros((order, 1))])
            c = np.block([[fd @ c[:1], fc], [c[1:], np.zeros((1, order))]])
    out = _respond(a, b, c, force, 1 / (rate * FINER))
    return out[0, ::FINER].copy(), out[1, ::FINER].copy()


def _respond(a: np.ndarray, b: np.ndarray, c: np.ndarray, force: np.ndarray, step: float) -> np.ndarray:
    """Sum the decaying modes, each a recursion of first order: exact for a force linear between samples."""
    no_feedthrough = np.zeros((len(c), 1))
    ad, bd, cd, dd, _ = signal.cont2discrete((a, b, c, no_feedthrough), step, method="foh")
    poles, shapes = np.linalg.eig(ad)
    drive = np.linalg.solve(shapes, bd.astype(complex))[:, 0]
    out = dd @ force[None, :] + 0j
    for pole, shape, part in zip(poles, (cd @ shapes).T, drive, strict=True):
        out += np.outer(shape, signal.lfilter([0, part], [1, -pole], force.astype(complex)))
    return out.real
