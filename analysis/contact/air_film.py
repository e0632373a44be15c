"""Air between two flats: what a squeezed film adds to contact stiffness and damping, and how close the flats may be.

Linearised Reynolds equation, isothermal, for a square film that is open at its edges (Langlois 1962, Blech 1983): the
pressure is a sum over odd m and n, each of which leaks with a rate of its own.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

PRESSURE_PA, VISCOSITY_PA_S = 101325.0, 1.83e-5  # air at 20 degrees C
ORDERS = np.arange(1.0, 400.0, 2.0)
GAPS_M = (1e-8, 1e-4)  # among which `least_gap` looks


def film_stiffness(
    side_m: float,
    gap_m: float,
    frequency_hz: float,
    pressure_pa: float = PRESSURE_PA,
    viscosity_pa_s: float = VISCOSITY_PA_S,
) -> complex:
    """Return the film's dynamic stiffness, N/m: its real part is a spring, its imaginary part omega times a damper.

    Examples
    --------
    >>> film = film_stiffness(1.35e-3, 1e-6, 2000.0)
    >>> f"{film.real:.3g} {film.imag:.3g}"
    '1.11e+05 5.59e+04'
    """
    m, n = np.meshgrid(ORDERS, ORDERS)
    lag = 24j * math.pi * frequency_hz * viscosity_pa_s * side_m**2 / (pressure_pa * gap_m**2 * math.pi**2)
    modes = 64 / (math.pi**4 * m**2 * n**2) * lag / (m**2 + n**2 + lag)
    return complex(pressure_pa * side_m**2 / gap_m * modes.sum())


def film_damping_ratio(
    side_m: float, gap_m: float, frequency_hz: float, contact_stiffness: float, tube_stiffness: float
) -> float:
    """Return the damping ratio of the contact mode by the film alone; ``contact_stiffness`` (N/m) holds its spring.

    The mode's stiffness is that of the contact and half of one tube spring, ``tube_stiffness`` (N/m).
    """
    film = film_stiffness(side_m, gap_m, frequency_hz)
    return film.imag / (2 * contact_stiffness + tube_stiffness)


def least_gap(
    side_m: float, frequency_hz: float, contact_stiffness: float, tube_stiffness: float, damping_ratio: float
) -> float | None:
    """Return the mean distance of the flats, m, below which air alone would damp more than was measured.

    None where even the closest film damps less.
    """

    def more(log_gap: float) -> float:
        own = film_damping_ratio(side_m, math.exp(log_gap), frequency_hz, contact_stiffness, tube_stiffness)
        return own - damping_ratio

    grid = np.linspace(math.log(GAPS_M[0]), math.log(GAPS_M[1]), 200)
    over = [i for i, log_gap in enumerate(grid) if more(log_gap) > 0]
    if not over or over[-1] + 1 == len(grid):
        return None
    return math.exp(brentq(more, grid[over[-1]], grid[over[-1] + 1]))
