"""What stands still: contact stiffness and damping against load, and load against stage position."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from sim_backend.settings import SimulatedContact

SMALLEST_LOAD_N = 1e-3  # below it the contact is taken as a spring of the stiffness it has there
LARGEST_LOAD_N = 20.0
POINTS_PER_DECADE = 40  # of a contact stiffness given as a function
LARGEST_DAMPING_RATIO = 0.3  # beyond the table's points; the paper's largest is 0.17


class PowerLaw:
    """A quantity against load: straight lines in log-log between points, and on beyond the first and last.

    Parameters
    ----------
    load_n
        Loads, N, (n,) growing, n at least 2.
    value
        (n,) above zero.
    """

    def __init__(self, load_n: ArrayLike, value: ArrayLike):
        self.load_n = np.asarray(load_n, dtype=float)
        self.value = np.asarray(value, dtype=float)
        if self.load_n.ndim != 1 or len(self.load_n) < 2 or self.load_n.shape != self.value.shape:
            raise ValueError("loads and values need one length, at least 2")
        if not (np.all(self.value > 0) and np.all(np.diff(self.load_n, prepend=0.0) > 0)):
            raise ValueError("loads must grow from above zero, and values must be above zero")
        self.exponent = np.diff(np.log(self.value)) / np.diff(np.log(self.load_n))

    def segment(self, load_n: float) -> int:
        """Return the index of the straight line that holds at a load."""
        return min(max(int(self.load_n.searchsorted(load_n)) - 1, 0), len(self.exponent) - 1)

    def __call__(self, load_n: float) -> float:
        """Return the value at a load above zero, N."""
        i = self.segment(load_n)
        return float(self.value[i] * (load_n / self.load_n[i]) ** self.exponent[i])


class ContactTable:
    """k_c(P) and zeta_c(P) from the lists of the settings."""

    def __init__(self, settings: SimulatedContact):
        load = np.array(settings.load_mn) * 1e-3
        self._stiffness = PowerLaw(load, np.array(settings.contact_stiffness_n_per_um) * 1e6)
        self._damping_ratio = PowerLaw(load, settings.damping_ratio)
        self._largest_ratio = max(LARGEST_DAMPING_RATIO, *settings.damping_ratio)

    def stiffness(self, load_n: float) -> float:
        """Return k_c, N/m."""
        return self._stiffness(load_n)

    def damping_ratio(self, load_n: float) -> float:
        """Return zeta_c; a steep power law beyond the first point ends at `LARGEST_DAMPING_RATIO`."""
        return min(self._damping_ratio(load_n), self._largest_ratio)

    @property
    def load_n(self) -> NDArray[np.float64]:
        """Loads of the table, N."""
        return self._stiffness.load_n


class StaticEquilibrium:
    """Load against overlap: stage position less contact position = P / k1 + P / k2 + delta_c(P).

    delta_c(P) is P0 / k_c(P0) + the integral of dP / k_c(P) from P0 = 1 mN on, where k_c is a power law between
    points and the integral therefore closed; below P0 the contact is a spring.

    Parameters
    ----------
    stiffness
        k_c(P): N to N/m.
    loads_n
        Points between which k_c is taken as a power law, N.
    k1, k2
        Tube springs, N/m.
    """

    def __init__(self, stiffness: Callable[[float], float], loads_n: NDArray[np.float64], k1: float, k2: float):
        inside = loads_n[(loads_n > SMALLEST_LOAD_N) & (loads_n < LARGEST_LOAD_N)]
        loads = np.concatenate([[SMALLEST_LOAD_N], inside, [LARGEST_LOAD_N]])
        self._law = PowerLaw(loads, [stiffness(p) for p in loads])
        self._springs = 1 / k1 + 1 / k2
        # value at each point, then at any load by the closed integral from the point below
        self._approach = np.empty(len(loads))
        self._approach[0] = loads[0] / self._law.value[0]
        for i in range(len(loads) - 1):
            self._approach[i + 1] = self._approach[i] + self._integral(i, float(loads[i + 1]))

    @classmethod
    def of_table(cls, table: ContactTable, k1: float, k2: float) -> Self:
        """Return the equilibrium of a tabled contact, exact with its power laws."""
        return cls(table.stiffness, table.load_n, k1, k2)

    @classmethod
    def of_function(cls, stiffness: Callable[[float], float], k1: float, k2: float) -> Self:
        """Return the equilibrium of a contact given as a function, sampled evenly in log P."""
        decades = math.log10(LARGEST_LOAD_N / SMALLEST_LOAD_N)
        return cls(stiffness, np.geomspace(SMALLEST_LOAD_N, LARGEST_LOAD_N, round(decades * POINTS_PER_DECADE)), k1, k2)

    def _integral(self, i: int, load_n: float) -> float:
        """Return the integral of dP / k_c from point ``i`` to ``load_n``, m."""
        start, e = float(self._law.load_n[i]), float(self._law.exponent[i])
        log_ratio = math.log(load_n / start)
        flexibility = start / float(self._law.value[i])
        if abs(e - 1) * abs(log_ratio) < 1e-9:
            return flexibility * log_ratio
        return flexibility * math.expm1((1 - e) * log_ratio) / (1 - e)

    def contact_approach(self, load_n: float) -> float:
        """Return delta_c, m, at a load, N."""
        if load_n <= SMALLEST_LOAD_N:
            return max(load_n, 0.0) / float(self._law.value[0])
        i = self._law.segment(load_n)
        return float(self._approach[i]) + self._integral(i, load_n)

    def overlap(self, load_n: float) -> float:
        """Return how far the stage is past first contact, m, at a load, N."""
        return load_n * self._springs + self.contact_approach(load_n)

    def load(self, overlap_m: float) -> float:
        """Return the load, N, when the stage is ``overlap_m`` past first contact; 0 when the surfaces are apart."""
        if overlap_m <= 0:
            return 0.0
        # the springs alone would carry more than springs and contact together
        highest = overlap_m / self._springs
        return float(brentq(lambda p: self.overlap(p) - overlap_m, 0.0, highest, xtol=1e-13, rtol=1e-13))
