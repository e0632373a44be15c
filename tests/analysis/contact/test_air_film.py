"""Air between flats against finite differences, its limits, and the gap that a measured damping allows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import diags, identity, kron
from scipy.sparse.linalg import spsolve

from analysis.contact.air_film import (
    PRESSURE_PA,
    VISCOSITY_PA_S,
    film_damping_ratio,
    film_stiffness,
    least_gap,
)

SIDE = 1.35e-3


def by_finite_differences(side: float, gap: float, hz: float, count: int = 99) -> complex:
    """Stiffness of the film, N/m: (d2/dx2 + d2/dy2) p = i w 12 mu / (p_a h^2) (p + p_a d / h), p = 0 at the edges."""
    step = side / (count + 1)
    line = diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(count, count)) / step**2
    leak = kron(line, identity(count)) + kron(identity(count), line)
    lag = 24j * np.pi * hz * VISCOSITY_PA_S / (PRESSURE_PA * gap**2)
    raised = spsolve((lag * identity(count**2) - leak).tocsc(), np.full(count**2, lag, complex))
    return complex(PRESSURE_PA / gap * raised.sum() * step**2)


@pytest.mark.parametrize(("gap", "hz"), [(0.7e-6, 1400.0), (2e-6, 2200.0), (8e-6, 2200.0)])
def test_the_film_is_the_linear_reynolds_equation(gap: float, hz: float) -> None:
    expected, found = by_finite_differences(SIDE, gap, hz), film_stiffness(SIDE, gap, hz)
    assert abs(found - expected) < 0.01 * abs(expected)


def test_a_fast_film_is_a_spring_of_its_pressure_and_a_slow_one_a_damper() -> None:
    assert film_stiffness(SIDE, 1e-7, 1e6).real == pytest.approx(PRESSURE_PA * SIDE**2 / 1e-7, rel=0.01)
    slow = film_stiffness(SIDE, 5e-5, 10.0)
    assert slow.imag == pytest.approx(0.42173 * VISCOSITY_PA_S * 20 * np.pi * SIDE**4 / 5e-5**3, rel=1e-3)
    assert slow.real < 1e-3 * slow.imag


def test_the_least_gap_has_the_measured_damping_and_less_is_damped_more() -> None:
    rest = (SIDE, 1925.0, 7.63e6, 0.538e6)
    gap = least_gap(*rest, 0.0016)
    assert gap is not None
    assert film_damping_ratio(SIDE, gap, *rest[1:]) == pytest.approx(0.0016, rel=1e-6)
    assert film_damping_ratio(SIDE, 0.9 * gap, *rest[1:]) > 0.0016 > film_damping_ratio(SIDE, 1.1 * gap, *rest[1:])


def test_damping_that_no_film_reaches_bounds_nothing() -> None:
    assert least_gap(SIDE, 1925.0, 7.63e6, 0.538e6, 0.05) is None
