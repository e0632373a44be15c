"""The exact ring-down against a matrix exponential of the free decay, scipy's integrators, and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import lsim

from rig.settings import Filter
from sim_backend.propagate.exact_step import phi_functions
from sim_backend.pulses import SHAPES, half_sine, sampled
from sim_backend.recorder import analog_filter
from sim_backend.ring_down import ring_down_linear
from sim_backend.two_mass import TwoMass, contact_damping

RATE = 25000.0
TESTER = TwoMass(0.107, 0.108, 0.5379e6, 0.54e6, 7.5e6, contact_damping(7.5e6, 0.02, 0.107, 0.108), 2.0, 2.0)
FILTER = analog_filter(Filter())


def integrated(tester, pulse, onset, samples, filtered=True):
    """Acceleration and x2 at the samples by DOP853, restarted at each knot."""
    nf = len(FILTER.b)

    def slope(t, y, inside):
        x1, x2, v1, v2 = y[:4]
        contact = tester.kc * (x1 - x2) + tester.cc * (v1 - v2)
        force = float(pulse(t - onset)) if inside else 0.0
        a1 = (force - contact - tester.k1 * x1 - tester.c1 * v1) / tester.m1
        a2 = (contact - tester.k2 * x2 - tester.c2 * v2) / tester.m2
        return np.concatenate([[v1, v2, a1, a2], FILTER.a @ y[4:] + FILTER.b * a2])

    at = np.arange(samples) / RATE
    y, out = np.zeros(4 + nf), np.zeros((4 + nf, samples))
    edges = [*(onset + pulse.knots), at[-1] + 1e-9]
    scale = np.concatenate([np.full(2, 1e-7), np.full(2, 1e-3), np.full(nf, 1.0)])
    for left, right in pairwise(edges):
        here = (at >= left) & (at < right)
        inside = left < edges[-2]
        # evaluated a hair inside, so that no stage sees the other side of a knot
        solution = solve_ivp(
            lambda t, y, i=inside, r=right: slope(min(t, r - 1e-15), y, i),
            (left, right),
            y,
            "DOP853",
            dense_output=True,
            rtol=1e-13,
            atol=1e-13 * scale,
        )
        out[:, here] = solution.sol(at[here])
        y = solution.y[:, -1]
    contact = tester.kc * (out[0] - out[1]) + tester.cc * (out[2] - out[3])
    raw = (contact - tester.k2 * out[1] - tester.c2 * out[3]) / tester.m2
    return (FILTER.c[0] @ out[4:] if filtered else raw), out[1], contact


def assert_close(ours, theirs, share):
    assert np.max(np.abs(ours - theirs)) < share * np.max(np.abs(theirs))


@pytest.mark.parametrize("shape", [*SHAPES, "table"])
def test_agrees_with_a_tight_integration(shape):
    pulse = sampled([0, 5e-5, 1.3e-4, 3e-4], [0, 2, 1, 0]) if shape == "table" else SHAPES[shape](1.3, 3e-4)
    response = ring_down_linear(TESTER, pulse, 5.27e-5, 200, RATE, FILTER)
    acceleration, x2, contact = integrated(TESTER, pulse, 5.27e-5, 200)
    assert_close(response.acceleration, acceleration, 1e-9)
    assert_close(response.lower_displacement, x2, 1e-9)
    assert_close(response.contact_force, contact, 1e-9)


def test_agrees_with_lsim_on_a_fine_grid():
    pulse = sampled([0, 1e-4, 3e-4], [0, 2, 0])  # straight lines: lsim's first-order hold is exact
    fine = np.arange(20001) / (RATE * 20)
    system = TESTER.state_space()
    _, y, _ = lsim((system.a, system.b[:, None], system.c, system.d[:, None]), pulse(fine - 4e-5), fine)
    response = ring_down_linear(TESTER, pulse, 4e-5, 1001, RATE)
    assert_close(response.acceleration, y[::20, 0], 1e-9)


def test_matrix_exponential_is_scipys():
    rng = np.random.default_rng(0)
    for size in (1e-3, 0.3, 2.0, 20.0):
        a = size * rng.standard_normal((9, 9)) - size * np.eye(9)
        assert_close(phi_functions(a, 1)[0, 0], expm(a), 1e-11)
    assert np.array_equal(phi_functions(np.zeros((3, 3)), 1)[0, 0], np.eye(3))


def test_free_decay_follows_the_matrix_exponential():
    r = ring_down_linear(TESTER, half_sine(1.0, 3e-4), 1e-6, 5000, RATE)
    state = np.array([r.approach + r.lower_displacement, r.lower_displacement])
    # velocities from the outputs: v1 - v2 is one, v2 follows from the acceleration
    v2 = (r.contact_force - TESTER.m2 * r.acceleration - TESTER.k2 * r.lower_displacement) / TESTER.c2
    first = np.array([*state[:, 100], r.approach_rate[100] + v2[100], v2[100]])
    later = expm(TESTER.state_matrix() * 4000 / RATE) @ first
    assert later[:2] == pytest.approx(state[:, 4100], rel=1e-7, abs=1e-15)


def test_response_does_not_depend_on_where_the_samples_fall():
    pulse = half_sine(1.0, 3e-4)
    fine = ring_down_linear(TESTER, pulse, 0.0, 4000, RATE * 8, FILTER)
    shifted = ring_down_linear(TESTER, pulse, 3 / (8 * RATE), 400, RATE, FILTER)
    assert_close(shifted.acceleration[1:], fine.acceleration[5::8][:399], 1e-11)


def test_momentum_of_the_pulse_stays_in_the_masses():
    free = TwoMass(0.107, 0.108, 1e-6, 1e-6, 7.5e6, 10.0)
    r = ring_down_linear(free, half_sine(1.0, 3e-4), 0.0, 200, RATE)
    v2 = np.gradient(r.lower_displacement, 1 / RATE, edge_order=2)
    momentum = 0.107 * r.approach_rate + (0.107 + 0.108) * v2
    assert np.mean(momentum[100:190]) == pytest.approx(half_sine(1.0, 3e-4).impulse_ns(), rel=1e-3)


def test_two_impacts_add_up():
    one, other = half_sine(1.0, 3e-4), half_sine(0.4, 3e-4)
    both = ring_down_linear(TESTER, one.followed_by(other, 2.345e-3), 1e-5, 500, RATE, FILTER).acceleration
    a = ring_down_linear(TESTER, one, 1e-5, 500, RATE, FILTER).acceleration
    b = ring_down_linear(TESTER, other, 1e-5 + 2.345e-3, 500, RATE, FILTER).acceleration
    assert_close(both, a + b, 1e-11)


def test_undamped_system_mode_keeps_its_energy_over_the_whole_record():
    t = TwoMass(0.1, 0.1, 5e5, 5e5, 7e6, 60.0)  # equal masses: only the contact mode is damped
    x2 = ring_down_linear(t, half_sine(1.0, 3e-4), 0.0, 15000, RATE).lower_displacement
    early, late = x2[5000:6000], x2[14000:15000]
    assert np.std(late) == pytest.approx(np.std(early), rel=1e-2)
    assert np.ptp(late) == pytest.approx(np.ptp(early), rel=1e-3)


def test_overdamped_contact_is_no_special_case():
    t = TwoMass(0.107, 0.108, 5e5, 5e5, 1e6, contact_damping(1e6, 2.0, 0.107, 0.108), 1.0, 1.0)
    response = ring_down_linear(t, half_sine(1.0, 3e-4), 1e-5, 100, RATE, FILTER)
    assert_close(response.acceleration, integrated(t, half_sine(1.0, 3e-4), 1e-5, 100)[0], 1e-8)


def test_pulse_may_lie_beyond_the_record():
    r = ring_down_linear(TESTER, half_sine(1.0, 3e-4), 1.0, 100, RATE, FILTER)
    assert not np.any(r.acceleration)
