"""An exact two-mass tester for the tests of this package: Eq. 9 in state space, solved by `scipy.signal.lsim`.

`lsim` is exact for an input that is linear between samples; the pulse is sampled eight times as finely as the record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

FINER = 8


@dataclass(frozen=True)
class Tester:
    """Masses kg, springs N/m, contact stiffness N/m, dampers N s/m."""

    k_c: float = 5e6
    c_c: float = 5.0
    m1: float = 0.107
    m2: float = 0.108
    k: float = 0.5379e6
    c: float = 1.0

    @classmethod
    def damped(cls, k_c: float, zeta_c: float, zeta_s: float = 0.003) -> Tester:
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
    tester: Tester,
    blows: list[tuple[float, float]],
    pulse_s: float = 4e-4,
    samples: int = 2500,
    pretrigger: int = 250,
    rate: float = 25000.0,
    filtered: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return a2 (n,) and contact force (n,) of half-sine blows given as (seconds after the first, peak in N)."""
    t = np.arange(samples * FINER) / (rate * FINER)
    force = np.zeros_like(t)
    for delay, peak in blows:
        since = t - pretrigger / rate - delay
        force += np.where((since > 0) & (since < pulse_s), peak * np.sin(np.pi * since / pulse_s), 0.0)
    _, out, _ = signal.lsim(tester.state_space(), force, t)
    if filtered:
        for order, corner, kind in ((1, 10.0, "highpass"), (4, 10000.0, "lowpass")):
            zpk = signal.butter(order, 2 * np.pi * corner, kind, analog=True, output="ba")
            _, a2, _ = signal.lsim(zpk, out[:, 0], t)
            out[:, 0] = a2
    return out[::FINER, 0].copy(), out[::FINER, 1].copy()
