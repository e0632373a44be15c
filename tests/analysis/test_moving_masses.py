"""k_c of a tester whose tube springs have mass: recovered where it is declared, low as predicted where it is not."""

import math

import numpy as np
import pytest

from analysis.modal.modes import ModeEstimate
from analysis.moving_masses import moving_masses
from analysis.session import KnownRig
from analysis.stiffness import pole, springs_from_system_mode
from calibration.estimate import Estimate
from daq.records import RigDescription
from rig.settings import Masses, RigSettings, Springs, TubeSettings
from sim_backend.settings import SimBackendSettings, SimulatedContact
from sim_backend.static import ContactTable
from sim_backend.truth import TrueRig, draw_parameters
from sim_backend.two_mass import TwoMass

SPRINGS = Springs(system_resonance_hz=356.0, tube=TubeSettings())
RIG = RigSettings(springs=SPRINGS)
BARE = RigDescription(m1_kg=0.107, m2_kg=0.108, k1_n_per_m=538e3, k2_n_per_m=538e3)


def simulated(load_n):
    """Return Eq. 9 of the simulated rig with eight states at a load: two masses and two walls that ride on them."""
    settings = SimBackendSettings(parameter_errors=False)
    true = TrueRig(draw_parameters(RIG, settings, 1), ContactTable(SimulatedContact()), None)
    return true.tester(load_n)


def stiffness(tester, springs):
    """Return k_c as an analysis has it that knows of the tubes what ``springs`` say; the header says nothing."""
    f1, _, f2, zeta2 = tester.modes()
    moving, _ = moving_masses(BARE, Masses(), springs)
    m1, m2 = moving.m1, moving.m2
    k1, k2 = springs_from_system_mode(f1, tester.kc, *(m.value for m in moving.at(f1)))
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = moving.covariance
    known = KnownRig(m1, m2, Estimate(k1, 0.0), Estimate(k2, 0.0), covariance, own_mode=moving.own_mode)
    mode = ModeEstimate(pole(f2, zeta2), np.zeros((2, 2)), np.ones(1, complex))
    return known.contact(mode).stiffness_n_per_m


@pytest.mark.parametrize("load_n", [0.2649, 0.5248, 0.927])
def test_with_the_tubes_declared_k_c_comes_out(load_n):
    tester = simulated(load_n)
    assert len(tester.state_matrix()) == 8
    found = stiffness(tester, SPRINGS)
    assert found.value == pytest.approx(tester.kc, rel=3e-4)
    assert found.half_width > 0.002 * tester.kc  # 5 % of 2.7 g is not known


@pytest.mark.parametrize("load_n", [0.2649, 0.5248, 0.927])
def test_without_them_it_is_low_by_2_5_to_2_7_percent(load_n):
    tester = simulated(load_n)
    low = stiffness(tester, Springs(system_resonance_hz=356.0)).value / tester.kc - 1
    assert -0.027 < low < -0.025


def test_a_header_with_the_tubes_in_it_is_not_added_to_again():
    inertia = SPRINGS.inertia()
    header = RigDescription(
        m1_kg=0.1097, m2_kg=0.1107, tube_added_kg=0.0027, tube_mode_kg=inertia.own_mode.mass_kg,
        tube_mode_hz=inertia.own_mode.frequency_hz,
    )  # fmt: skip
    found, notes = moving_masses(header, Masses(), SPRINGS)
    assert (found.m1.value, notes) == (0.1097, [])
    assert found.own_mode == inertia.own_mode
    assert "added to the session's masses" in moving_masses(BARE, Masses(), SPRINGS)[1][0]


def test_without_a_tube_nothing_changes():
    found, notes = moving_masses(BARE, Masses(), Springs(system_resonance_hz=356.0))
    assert (found.m1.value, found.at(2000.0)[1].value, notes) == (0.107, 0.108, [])
    np.testing.assert_allclose(found.covariance, np.eye(2) * 0.00005**2)


def test_what_is_not_known_of_the_tubes_is_common_to_both_masses():
    covariance = moving_masses(BARE, Masses(), SPRINGS)[0].covariance
    assert covariance[0, 1] == pytest.approx(SPRINGS.inertia().uncertainty_kg ** 2)
    assert covariance[0, 0] == pytest.approx(covariance[0, 1] + 0.00005**2)


def test_a_light_own_mode_leaves_the_four_states_alone():
    plain = TwoMass(0.107, 0.108, 5e5, 5e5, 7e6, 5.0)
    mode = SPRINGS.inertia().own_mode
    light = TwoMass(0.107, 0.108, 5e5, 5e5, 7e6, 5.0, tube_mode=type(mode)(1e-9, 6e3))
    assert light.modes() == pytest.approx(plain.modes(), rel=1e-6, abs=1e-9)
    heavy = TwoMass(0.107, 0.108, 5e5, 5e5, 7e6, 5.0, tube_mode=mode)
    ratio = heavy.modes()[2] / plain.modes()[2]
    x = (plain.modes()[2] / mode.frequency_hz) ** 2
    assert ratio == pytest.approx(math.sqrt(0.1075 / (0.1075 + mode.mass_kg * x / (1 - x))), rel=1e-3)
