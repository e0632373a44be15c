import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from sim_backend.settings import SimulatedContact
from sim_backend.static import SMALLEST_LOAD_N, ContactTable, PowerLaw, StaticEquilibrium

K1, K2 = 0.54e6, 0.53e6
TABLE = ContactTable(SimulatedContact())


def test_power_law_goes_through_its_points_and_is_one_between():
    law = PowerLaw([0.1, 1.0], [2.0, 20.0])
    assert [law(0.1), law(0.5), law(1.0), law(3.0), law(0.01)] == pytest.approx([2, 10, 20, 60, 0.2])


def test_table_gives_the_values_of_the_settings():
    assert TABLE.stiffness(0.5248) == pytest.approx(7.59e6)
    assert TABLE.damping_ratio(0.2649) == pytest.approx(0.028)


def test_damping_ratio_stays_below_its_bound_at_light_loads():
    assert TABLE.damping_ratio(0.02) == pytest.approx(0.3)


@pytest.mark.parametrize("load", [0.0005, 0.05, 0.3, 0.9, 3.0])
def test_contact_approach_is_the_integral_of_the_compliance(load):
    equilibrium = StaticEquilibrium.of_table(TABLE, K1, K2)
    base = min(load, SMALLEST_LOAD_N) / TABLE.stiffness(SMALLEST_LOAD_N)
    points = [p for p in TABLE.load_n if SMALLEST_LOAD_N < p < load]
    integral = quad(lambda p: 1 / TABLE.stiffness(p), SMALLEST_LOAD_N, max(load, SMALLEST_LOAD_N), points=points)[0]
    assert equilibrium.contact_approach(load) == pytest.approx(base + integral, rel=1e-7)


def test_hertzian_contact_has_its_closed_form():
    # k = (P E^2)^(1/3) up to constants: delta grows as P^(2/3), delta = 1.5 P / k
    def stiffness(p):
        return 2e6 * p ** (1 / 3)

    equilibrium = StaticEquilibrium.of_function(stiffness, K1, K2)
    missing = 1.5 * SMALLEST_LOAD_N / stiffness(SMALLEST_LOAD_N) - SMALLEST_LOAD_N / stiffness(SMALLEST_LOAD_N)
    assert equilibrium.contact_approach(0.5) + missing == pytest.approx(1.5 * 0.5 / stiffness(0.5), rel=1e-9)


@settings(max_examples=50, deadline=None)
@given(st.floats(1e-6, 10.0))
def test_load_undoes_overlap(load):
    equilibrium = StaticEquilibrium.of_table(TABLE, K1, K2)
    assert equilibrium.load(equilibrium.overlap(load)) == pytest.approx(load, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("overlap", [0.0, -1e-9, -1.0])
def test_no_load_when_apart(overlap):
    assert StaticEquilibrium.of_table(TABLE, K1, K2).load(overlap) == 0.0


def test_load_grows_with_overlap():
    equilibrium = StaticEquilibrium.of_table(TABLE, K1, K2)
    loads = [equilibrium.load(x) for x in np.linspace(0, 8e-6, 200)]
    assert np.all(np.diff(loads) > 0)
