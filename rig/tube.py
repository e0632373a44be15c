"""The inertia of a tube spring: what of it moves with its block, and its first mode of its own.

A tube spring is a short tube held along two opposite lines of its wall, at the frame and at a block. Pressed across
that diameter it is a spring, and its wall moves; Eq. 9 leaves this out. The ring is thin and inextensional: the free
one has the radial shapes cos(n theta) with tangential ones -sin(n theta) / n, and each answers a unit force on a line

    h_n = 1 / (pi (E I (n^2 - 1)^2 / R^3 - omega^2 rho A R (1 + 1 / n^2))),    n = 1, 2, ...

(Love's ring; n = 1 is the ring as a whole). Held at the one line, it answers the block at the other with the dynamic
stiffness

    D = (1 / S_odd + 1 / S_even) / 4 = k - omega^2 m(omega),

S the sums of h_n over odd and even n. k is that of the thin-ring formula, E I / (0.1488 R^3), and m the mass that
moves with the block.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
TERMS = 400  # of the Fourier series; what is left out is below 1e-6 of k
STILL_HZ = 1.0  # a frequency at which the tube is quasi-static
REFERENCE = 1 / 3  # of the own mode's frequency: there `OwnMode` is made to agree with the series
CONVERGED = 1e-13  # relative, of the own mode's frequency
HIGHEST = 0.5  # of the own mode's frequency, up to which a tube spring is a spring and a mass


@dataclass(frozen=True, slots=True)
class OwnMode:
    """A mode of the tube with its block held: ``mass_kg`` on a mount that resonates at ``frequency_hz``.

    At a frequency f it adds mass_kg x / (1 - x), x = (f / frequency_hz)^2, to the mass that moves with the block; above
    half of its frequency what it adds there.
    """

    mass_kg: float
    frequency_hz: float

    @property
    def stiffness(self) -> float:
        """Stiffness of the mount, N/m."""
        return self.mass_kg * (2 * math.pi * self.frequency_hz) ** 2

    def added_mass(self, f_hz: float) -> float:
        """Return what the mode adds at ``f_hz``, kg."""
        x = min(f_hz / self.frequency_hz, HIGHEST) ** 2
        return self.mass_kg * x / (1 - x)


@dataclass(frozen=True, slots=True)
class Tube:
    """A tube spring.

    Attributes
    ----------
    youngs_modulus, poisson_ratio, density
        Pa, 1 and kg/m3.
    radius, wall, length
        Mean radius, wall and length, m.

    Examples
    --------
    >>> tube = Tube(192.92e9, 0.29, 7900.0, 9.25e-3, 0.5e-3, 30e-3)  # Sec. 3.1
    >>> f"{1e3 * tube.mass:.2f} g, of which {1e3 * tube.added_mass(356.0):.2f} g move with the block at 356 Hz"
    '6.89 g, of which 2.70 g move with the block at 356 Hz'
    """

    youngs_modulus: float
    poisson_ratio: float
    density: float
    radius: float
    wall: float
    length: float

    @property
    def mass(self) -> float:
        """Mass of the whole tube, kg."""
        return 2 * math.pi * self.radius * self.length * self.wall * self.density

    @property
    def stiffness(self) -> float:
        """Stiffness across the diameter, N/m, in plane strain: a tube longer than wide keeps its wall straight."""
        return 1 / (4 * float(self._receptances(0.0)[1::2].sum()))

    def dynamic_stiffness(self, f_hz: float) -> float:
        """Return the force over the displacement of the line on the block, the other line held, N/m."""
        h = self._receptances(2 * math.pi * f_hz)
        return (1 / float(h[::2].sum()) + 1 / float(h[1::2].sum())) / 4

    def added_mass(self, f_hz: float) -> float:
        """Return the mass that moves with the block at ``f_hz``, kg."""
        f = max(f_hz, STILL_HZ)
        return (self.stiffness - self.dynamic_stiffness(f)) / (2 * math.pi * f) ** 2

    def own_mode(self) -> OwnMode:
        """Return the first mode that moves the block, the block held: where the sum over odd n vanishes.

        Its mass makes `OwnMode.added_mass` that of the whole series at a third of its frequency, so that the modes
        above it are in it.
        """
        low, high = 0.0, self._free_hz(3)
        while high - low > CONVERGED * high:
            middle = (low + high) / 2
            below = float(self._receptances(2 * math.pi * middle)[::2].sum()) < 0
            low, high = (middle, high) if below else (low, middle)
        at = REFERENCE * high
        more = self.added_mass(at) - self.added_mass(STILL_HZ)
        return OwnMode(more / OwnMode(1.0, high).added_mass(at), high)

    def _bending(self) -> float:
        """E I of the wall in plane strain, N m2."""
        return self.youngs_modulus / (1 - self.poisson_ratio**2) * self.length * self.wall**3 / 12

    def _free_hz(self, n: int) -> float:
        """Frequency of the free ring with 2 n nodes, Hz."""
        inertia = self.density * self.wall * self.length * self.radius * (1 + 1 / n**2)
        return math.sqrt(self._bending() / self.radius**3 / inertia) * (n * n - 1) / (2 * math.pi)

    def _receptances(self, omega: float) -> FloatArray:
        """h_n, m/N, from n = 1 on, (TERMS,); the first is without bound at rest."""
        n = np.arange(1.0, TERMS + 1)
        stiffness = self._bending() / self.radius**3 * (n * n - 1) ** 2
        inertia = self.density * self.wall * self.length * self.radius * (1 + 1 / n**2)
        with np.errstate(divide="ignore"):
            return np.asarray(1 / (math.pi * (stiffness - omega**2 * inertia)), dtype=np.float64)
