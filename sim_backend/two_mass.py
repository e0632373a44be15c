"""The tester of Eq. 9: two masses, two tube springs, and the contact between them, about static equilibrium."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.tube import OwnMode
from sim_backend.state_space import StateSpace

TUBE_MODE_DAMPING = 2e-3  # ratio of a steel tube between set screws; nobody has measured it
UPPER, LOWER = 0, 1  # which mass is struck
PAIRING_TOLERANCE = 1e-9  # |Im s| / |s| below which a pole counts as real


@dataclass(frozen=True, slots=True)
class TwoMass:
    """Masses, springs and dampers of Eq. 9; gravity is balanced by the static deflection and drops out.

    Attributes
    ----------
    m1, m2
        Upper and lower mass, kg.
    k1, k2
        Upper and lower tube spring, N/m.
    kc, cc
        Contact stiffness, N/m, and contact damping, N s/m.
    c1, c2
        Dampers beside the tube springs, N s/m. Eq. 9 has none.
    tube_mode
        Own mode of each tube spring, on top of what the masses hold of it at rest. Eq. 9 has none.
    """

    m1: float
    m2: float
    k1: float
    k2: float
    kc: float
    cc: float
    c1: float = 0.0
    c2: float = 0.0
    tube_mode: OwnMode | None = None

    def state_matrix(self) -> NDArray[np.float64]:
        """Return the (4, 4) matrix of Eq. 9 for the state x1, x2 (m), v1, v2 (m/s).

        The contact pushes the lower mass with k_c (x1 - x2) + c_c (v1 - v2) and the upper one back. With own modes of
        the tube springs it is (8, 8): two more places after x2, two more velocities at the end.
        """
        k = np.array([[self.k1 + self.kc, -self.kc], [-self.kc, self.k2 + self.kc]])
        c = np.array([[self.c1 + self.cc, -self.cc], [-self.cc, self.c2 + self.cc]])
        mass = np.array([self.m1, self.m2])
        if self.tube_mode is not None:
            m, mount = self.tube_mode.mass_kg, self.tube_mode.stiffness
            mass = np.concatenate([mass - m, [m, m]])
            k = np.block([[k + mount * np.eye(2), -mount * np.eye(2)], [-mount * np.eye(2), mount * np.eye(2)]])
            damper = 2 * TUBE_MODE_DAMPING * math.sqrt(mount * m) * np.eye(2)
            c = np.block([[c + damper, -damper], [-damper, damper]])
        n = len(mass)
        a = np.zeros((2 * n, 2 * n))
        a[:n, n:] = np.eye(n)
        a[n:, :n], a[n:, n:] = -k / mass[:, None], -c / mass[:, None]
        return a

    def state_space(self, struck: int = UPPER) -> StateSpace:
        """Return the tester from the force on the mass that is struck, the upper one, N, to five outputs.

        In this order: acceleration of the lower mass (m/s2), x2 (m), dynamic contact force (N),
        approach x1 - x2 (m), its rate (m/s).
        """
        a = self.state_matrix()
        n = len(a) // 2
        place, apart = np.eye(2 * n)[1], np.zeros(2 * n)
        apart[:2] = 1.0, -1.0
        rate = np.roll(apart, n)
        b = np.zeros(2 * n)
        b[n + struck] = 1 / ((self.m1, self.m2)[struck] - (0.0 if self.tube_mode is None else self.tube_mode.mass_kg))
        outputs = np.stack([a[n + 1], place, self.kc * apart + self.cc * rate, apart, rate])
        return StateSpace(a, b, outputs, np.array([b[n + 1], 0.0, 0.0, 0.0, 0.0]))

    def poles(self) -> NDArray[np.complex128]:
        """Return the four roots s of Eq. 10 (s = j omega), rad/s; eight with own modes of the tube springs."""
        return np.linalg.eigvals(self.state_matrix()).astype(np.complex128)

    def modes(self) -> tuple[float, float, float, float]:
        """Return f1 (Hz), zeta1, f2 (Hz), zeta2 of the system and the contact mode, by growing frequency.

        f = |s| / 2 pi and zeta = -Re s / |s|. An overdamped mode has two real roots; they are taken together as
        the roots of s^2 + 2 zeta w s + w^2, so that zeta is above 1 and f is their geometric mean.
        """
        poles = self.poles()
        complex_pole = np.abs(poles.imag) > PAIRING_TOLERANCE * np.abs(poles)
        found = [(abs(s) / (2 * math.pi), -s.real / abs(s)) for s in poles[complex_pole & (poles.imag > 0)]]
        real = sorted(abs(s.real) for s in poles[~complex_pole])
        for slow, fast in zip(real[::2], real[1::2], strict=False):
            omega = math.sqrt(slow * fast)
            found.append((omega / (2 * math.pi), (slow + fast) / (2 * omega) if omega > 0 else math.nan))
        found.sort()
        (f1, zeta1), (f2, zeta2) = found[:2]
        return float(f1), float(zeta1), float(f2), float(zeta2)


def contact_damping(kc: float, zeta: float, m1: float, m2: float) -> float:
    """Return c_c, N s/m, that gives the contact mode of two free masses the damping ratio ``zeta``."""
    return 2 * zeta * math.sqrt(kc * m1 * m2 / (m1 + m2))


def tube_damping(zeta: float, m1: float, m2: float, k1: float, k2: float) -> float:
    """Return c1 = c2, N s/m, that gives the system mode (both masses as one) the damping ratio ``zeta``."""
    return zeta * math.sqrt((k1 + k2) * (m1 + m2))
