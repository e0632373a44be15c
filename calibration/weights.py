"""The force of the calibrating weights: mass, local gravity and air buoyancy, each with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.budget import Distribution

CLASSES = ("E1", "E2", "F1", "F2", "M1", "M2", "M3")
# largest permissible errors by OIML R 111-1:2004, Table 1, mg, in the order of CLASSES
PERMISSIBLE_MG = {
    500.0: (0.25, 0.8, 2.5, 8.0, 25.0, 80.0, 250.0),
    200.0: (0.10, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0),
    100.0: (0.05, 0.16, 0.5, 1.6, 5.0, 16.0, 50.0),
    50.0: (0.03, 0.10, 0.3, 1.0, 3.0, 10.0, 30.0),
    20.0: (0.025, 0.08, 0.25, 0.8, 2.5, 8.0, 25.0),
    10.0: (0.020, 0.06, 0.20, 0.6, 2.0, 6.0, 20.0),
    5.0: (0.016, 0.05, 0.16, 0.5, 1.6, 5.0, 16.0),
    2.0: (0.012, 0.04, 0.12, 0.4, 1.2, 4.0, 12.0),
    1.0: (0.010, 0.03, 0.10, 0.3, 1.0, 3.0, 10.0),
}

FREE_AIR = 3.086e-6  # 1/s2: by which gravity falls with height
ANOMALY = 5e-4  # m/s2: standard deviation of gravity about the normal formula (50 mGal)
HIGHEST_M = 1000.0  # height up to which a laboratory may be that does not say how high it is
LOWEST_GRAVITY, HIGHEST_GRAVITY = 9.777, 9.832  # m/s2: the equator at 1000 m, a pole at sea level
GRAVITY_RANGE = 0.004  # by which a mass that was told by its force may be off, relative
GIVEN_GRAVITY = 1e-5  # m/s2: standard uncertainty of a gravity that is given

AIR_DENSITY = 1.2, 0.06  # kg/m3 and the half-width of its range in a room (3 % weather, 2 % temperature)
WEIGHT_DENSITY = 8000.0, 900.0  # kg/m3, conventional, and the half-width from cast iron to brass


@dataclass(frozen=True, slots=True)
class Gravity:
    """Gravity where the rig stands, m/s2, its standard uncertainty, its distribution, and how it is known."""

    value: float
    standard_uncertainty: float
    distribution: Distribution
    source: str


def normal_gravity(latitude_deg: float, height_m: float = 0.0) -> float:
    """Gravity on the reference ellipsoid by the formula of Somigliana (WGS 84), less the free-air decrease, m/s2.

    Examples
    --------
    >>> round(normal_gravity(45.0), 4)
    9.8062
    """
    square = math.sin(math.radians(latitude_deg)) ** 2
    at_sea = 9.7803253359 * (1 + 0.00193185265241 * square) / math.sqrt(1 - 0.00669437999013 * square)
    return at_sea - FREE_AIR * height_m


def local_gravity(gravity_m_s2: float | None, latitude_deg: float | None, height_m: float | None) -> Gravity:
    """Return gravity as given, else by latitude and height, else the middle of what there is on Earth."""
    if gravity_m_s2 is not None:
        return Gravity(gravity_m_s2, GIVEN_GRAVITY, "normal", "given")
    if latitude_deg is None:
        middle, half = (LOWEST_GRAVITY + HIGHEST_GRAVITY) / 2, (HIGHEST_GRAVITY - LOWEST_GRAVITY) / 2
        return Gravity(middle, half / math.sqrt(3), "rectangular", "anywhere on Earth: no latitude is declared")
    if height_m is not None:
        return Gravity(normal_gravity(latitude_deg, height_m), ANOMALY, "normal", "by latitude and height")
    by_height = FREE_AIR * HIGHEST_M / 2 / math.sqrt(3)
    value = normal_gravity(latitude_deg, HIGHEST_M / 2)
    return Gravity(value, math.hypot(ANOMALY, by_height), "normal", f"by latitude, at 0 to {HIGHEST_M:g} m")


def buoyancy() -> float:
    """Share of its weight that the air takes off a mass of conventional density."""
    return AIR_DENSITY[0] / WEIGHT_DENSITY[0]


def buoyancy_half_width(of_mass: bool) -> float:
    """Half of the range of the buoyancy's share.

    Of forces computed from ``of_mass`` buoyancy is taken off and its inputs remain; of forces that were declared
    nobody knows whether it was.
    """
    if not of_mass:
        return buoyancy()
    return buoyancy() * (AIR_DENSITY[1] / AIR_DENSITY[0] + WEIGHT_DENSITY[1] / WEIGHT_DENSITY[0])


def permissible_error_mg(mass_g: float, weight_class: str) -> float:
    """Largest permissible error of a mass made of the usual pieces (5, 2, 2, 1), their errors added, mg.

    Examples
    --------
    >>> permissible_error_mg(100.0, "M1"), permissible_error_mg(70.0, "M1")
    (5.0, 5.5)
    """
    column = CLASSES.index(weight_class)
    least = GRAVITY_RANGE * mass_g
    left, total = mass_g, 0.0
    for piece, errors in PERMISSIBLE_MG.items():
        count = math.floor((left + least) / piece)
        total += count * errors[column]
        left -= count * piece
    return total + (PERMISSIBLE_MG[1.0][column] if left > least else 0.0)


def weight_errors_mn(load_mn: ArrayLike, weight_class: str | None, declared_mn: float) -> NDArray[np.float64]:
    """Standard uncertainty of each weight by itself, mN; none without a weight.

    Of a class it is the permissible error over sqrt(3), else what is declared.
    """
    loads: Sequence[float] = np.atleast_1d(np.asarray(load_mn, dtype=np.float64)).tolist()
    if weight_class is None:
        return np.array([declared_mn if load else 0.0 for load in loads])
    gravity = (LOWEST_GRAVITY + HIGHEST_GRAVITY) / 2
    return np.array([
        permissible_error_mg(abs(load) / gravity, weight_class) * 1e-3 * gravity / math.sqrt(3) for load in loads
    ])  # fmt: skip
