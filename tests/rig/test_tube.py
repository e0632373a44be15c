"""The tube spring's inertia against a finite-element ring that shares nothing with the Fourier series of `rig.tube`."""

import math

import numpy as np
import pytest
from scipy import linalg

from analysis.stiffness import ring_spring_stiffness
from rig.settings import RigSettings, Springs, TubeSettings
from rig.tube import Tube

E, NU, RHO, R, T, L = 192.92e9, 0.29, 7900.0, 9.25e-3, 0.5e-3, 30e-3
TUBE = Tube(E, NU, RHO, R, T, L)
ELEMENTS = 120  # of half a ring


def frame_element(E_wall, length):
    """Stiffness and consistent mass, (6, 6), of a straight beam that bends and stretches: u, v, turn at either end."""
    EA, EI, m = E_wall * L * T, E_wall * L * T**3 / 12, RHO * L * T * length
    k, mass = np.zeros((6, 6)), np.zeros((6, 6))
    k[np.ix_([0, 3], [0, 3])] = EA / length * np.array([[1, -1], [-1, 1]])
    mass[np.ix_([0, 3], [0, 3])] = m / 6 * np.array([[2, 1], [1, 2]])
    h, bending = length, [1, 2, 4, 5]
    k[np.ix_(bending, bending)] = EI / h**3 * np.array(
        [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2], [-12, -6 * h, 12, -6 * h],
         [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    )  # fmt: skip
    mass[np.ix_(bending, bending)] = m / 420 * np.array(
        [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2], [54, 13 * h, 156, -22 * h],
         [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]
    )  # fmt: skip
    return k, mass


class Ring:
    """Half of a ring from the line on the frame (0) to the line on the block (pi); both lines only move straight."""

    def __init__(self, E_wall):
        angle = np.linspace(0, math.pi, ELEMENTS + 1)
        x, y = R * np.sin(angle), -R * np.cos(angle)
        size = 3 * (ELEMENTS + 1)
        self.k, self.m = np.zeros((size, size)), np.zeros((size, size))
        for i in range(ELEMENTS):
            dx, dy = x[i + 1] - x[i], y[i + 1] - y[i]
            length = math.hypot(dx, dy)
            c, s = dx / length, dy / length
            turn = linalg.block_diag(*[np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])] * 2)
            k, m = frame_element(E_wall, length)
            at = np.arange(3 * i, 3 * i + 6)
            self.k[np.ix_(at, at)] += turn.T @ k @ turn
            self.m[np.ix_(at, at)] += turn.T @ m @ turn
        self.block = size - 2  # the block's line moves along y, without turning
        self.inside = np.arange(3, size - 3)

    def dynamic_stiffness(self, f_hz):
        d = self.k - (2 * math.pi * f_hz) ** 2 * self.m
        inner, edge = d[np.ix_(self.inside, self.inside)], d[self.inside, self.block]
        return 2 * (d[self.block, self.block] - edge @ np.linalg.solve(inner, edge))

    def added_mass(self, f_hz):
        return (self.dynamic_stiffness(0.0) - self.dynamic_stiffness(f_hz)) / (2 * math.pi * f_hz) ** 2

    def own_modes_hz(self):
        at = np.ix_(self.inside, self.inside)
        return np.sqrt(linalg.eigh(self.k[at], self.m[at], eigvals_only=True)[:2]) / (2 * math.pi)


@pytest.fixture(scope="module")
def ring():
    return Ring(E / (1 - NU**2))


def test_the_tube_weighs_6_9_g():
    assert TUBE.mass == pytest.approx(6.9e-3, rel=3e-3)


def test_at_rest_it_is_the_thin_ring_and_the_finite_elements(ring):
    assert TUBE.stiffness == pytest.approx(ring_spring_stiffness(E / (1 - NU**2), L, T, R), rel=1e-6)
    assert TUBE.stiffness == pytest.approx(ring.dynamic_stiffness(0.0), rel=2e-3)  # the wall also stretches


@pytest.mark.parametrize("f_hz", [100.0, 356.0, 955.0, 1410.0, 2234.0, 3000.0])
def test_added_mass_is_that_of_the_finite_elements(ring, f_hz):
    assert TUBE.added_mass(f_hz) == pytest.approx(ring.added_mass(f_hz), rel=2e-3)
    own = TUBE.added_mass(0.0) + TUBE.own_mode().added_mass(f_hz)
    assert own == pytest.approx(ring.added_mass(f_hz), rel=3e-3)


def test_2_70_g_move_at_the_system_resonance_and_2_92_g_at_2_2_khz_in_plane_stress():
    thin = Tube(E, 0.0, RHO, R, T, L)  # without Poisson's ratio a ring is in plane stress
    assert 1e3 * thin.added_mass(356.0) == pytest.approx(2.70, abs=0.005)
    assert 1e3 * thin.added_mass(2234.0) == pytest.approx(2.92, abs=0.005)
    assert 1e3 * Ring(E).added_mass(2234.0) == pytest.approx(2.92, abs=0.01)


def test_the_own_mode_lies_near_6_khz(ring):
    assert TUBE.own_mode().frequency_hz == pytest.approx(ring.own_modes_hz()[0], rel=3e-3)
    assert TUBE.own_mode().frequency_hz == pytest.approx(6e3, rel=0.02)


def test_in_plane_strain_the_published_tester_resonates_at_358_hz():
    moving = 0.107 + 0.108 + 2 * TUBE.added_mass(356.0)
    assert math.sqrt(2 * TUBE.stiffness / moving) / (2 * math.pi) == pytest.approx(358, abs=0.5)


def test_a_tube_in_the_configuration_moves_the_masses_and_the_springs_follow():
    given = RigSettings(springs=Springs(system_resonance_hz=356.0, tube=TubeSettings(youngs_modulus_gpa=192.92)))
    without = RigSettings()
    assert given.moving_masses()[0] - without.moving_masses()[0] == pytest.approx(TUBE.added_mass(0.0), rel=1e-9)
    share = 2 * TUBE.added_mass(356.0) / 0.215
    assert given.spring_stiffness()[0] == pytest.approx(without.spring_stiffness()[0] * (1 + share), rel=1e-6)


def test_an_added_mass_alone_has_no_mode_of_its_own():
    inertia = Springs(system_resonance_hz=356.0, added_mass_kg=0.0028, added_mass_uncertainty_percent=3).inertia()
    assert (inertia.added_mass(300.0), inertia.added_mass(2000.0)) == (0.0028, 0.0028)
    assert inertia.uncertainty_kg == pytest.approx(0.03 * 0.0028)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"tube": {}, "added_mass_kg": 0.002}, "either tube"),
        ({"tube": {"wall_mm": 3.0}}, "no thin ring"),
    ],
)
def test_what_cannot_be_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        Springs(system_resonance_hz=356.0, **wrong)
