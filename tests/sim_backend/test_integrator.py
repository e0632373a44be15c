"""The compiled integrator against the exact linear response and against scipy with located events."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig.errors import RigError
from rig.settings import Filter
from sim_backend.contact_laws import ContactLaw
from sim_backend.integrator import ring_down
from sim_backend.pulses import SHAPES, half_sine, sampled
from sim_backend.recorder import analog_filter
from sim_backend.ring_down import ring_down_linear
from sim_backend.two_mass import TwoMass, contact_damping

RATE = 25000.0
FILTER = analog_filter(Filter())
PRELOAD = 0.4
SAMPLES = 150


def bench(zeta=0.01):
    return TwoMass(0.107, 0.108, 0.5379e6, 0.54e6, 7.5e6, contact_damping(7.5e6, zeta, 0.107, 0.108), 2.0, 2.0)


def total_elastic(law, k, d):
    """Elastic force written as in the literature, in absolute approach."""
    if law == "hertz":
        delta0 = 1.5 * PRELOAD / k
        delta = delta0 + d
        return PRELOAD / delta0**1.5 * abs(delta) ** 1.5 * np.sign(delta), delta
    if law == "exponential":
        return PRELOAD * math.exp(k * d / PRELOAD), math.inf
    return PRELOAD + k * d, PRELOAD / k + d


def reference(t, law, can_part, pulse, onset, samples=SAMPLES, rtol=1e-13):
    """(5, samples) like `RingDown`: piecewise DOP853, restarted at knots and at events."""
    nf = len(FILTER.b)
    in_contact = [True]

    def force_and_state(d, rate):
        force, delta = total_elastic(law, t.kc, d)
        return force, delta, force + t.cc * rate

    def contact_force(y):
        d, rate = y[0] - y[1], y[2] - y[3]
        _, _, total = force_and_state(d, rate)
        if in_contact[0]:
            return total - PRELOAD
        return -PRELOAD if can_part else -PRELOAD + t.cc * rate

    def event(_t, y):
        _, delta, total = force_and_state(y[0] - y[1], y[2] - y[3])
        if not can_part:
            return delta if law == "hertz" else 1.0
        return total if in_contact[0] else min(total, delta * 1e6)

    event.terminal = True

    at = np.arange(samples) / RATE
    edges = [*(onset + pulse.knots), at[-1] + 1e-9]
    y, now, out = np.zeros(4 + nf), edges[0], np.zeros((5, samples))
    scale = np.concatenate([np.full(2, 1e-7), np.full(2, 1e-3), np.full(nf, 1.0)])
    for right in edges[1:]:
        inside = right < edges[-1]
        while now < right:

            def slope(time, y, inside=inside, right=right):
                contact = contact_force(y)
                force = float(pulse(min(time, right - 1e-15) - onset)) if inside else 0.0
                a1 = (force - contact - t.k1 * y[0] - t.c1 * y[2]) / t.m1
                a2 = (contact - t.k2 * y[1] - t.c2 * y[3]) / t.m2
                return np.concatenate([[y[2], y[3], a1, a2], FILTER.a @ y[4:] + FILTER.b * a2])

            event.direction = -1 if in_contact[0] else 1
            solution = solve_ivp(
                slope, (now, right), y, "DOP853", dense_output=True, events=event, rtol=rtol, atol=rtol * scale
            )
            end = solution.t[-1]
            for i in np.flatnonzero((at >= now) & (at < end)):
                z = solution.sol(at[i])
                out[:, i] = FILTER.c[0] @ z[4:], z[1], contact_force(z), z[0] - z[1], z[2] - z[3]
            y, now = solution.y[:, -1], end
            if solution.status == 1:
                in_contact[0] = not in_contact[0]
    return out


def columns(r):
    return np.array([r.acceleration, r.lower_displacement, r.contact_force, r.approach, r.approach_rate])


def worst(ours, theirs):
    """Largest error of each output over its peak."""
    return np.max(np.abs(columns(ours) - theirs), axis=1) / np.max(np.abs(theirs), axis=1)


@pytest.mark.parametrize("shape", SHAPES)
def test_linear_law_gives_the_exact_response_over_a_whole_record(shape):
    pulse = SHAPES[shape](0.4, 3e-4)
    exact = columns(ring_down_linear(bench(), pulse, 5.27e-5, 15000, RATE, FILTER))
    ours = ring_down(bench(), ContactLaw("linear", PRELOAD), pulse, 5.27e-5, 15000, RATE, FILTER)
    assert np.all(worst(ours, exact) < 1e-9)


def test_sampled_pulse_gives_the_exact_response():
    t = np.linspace(0, 4e-4, 57)
    pulse = sampled(t, 0.5 * np.sin(np.pi * t / 4e-4) ** 3)
    exact = columns(ring_down_linear(bench(), pulse, 1.1e-5, 3000, RATE, FILTER))
    ours = ring_down(bench(), ContactLaw("linear", PRELOAD), pulse, 1.1e-5, 3000, RATE, FILTER)
    assert np.all(worst(ours, exact) < 1e-9)


def test_two_blows_and_no_filter_give_the_exact_response():
    pulse = half_sine(0.4, 3e-4).followed_by(SHAPES["triangle"](0.2, 3e-4), 1e-4)
    exact = columns(ring_down_linear(bench(), pulse, 1.1e-5, 1000, RATE))
    ours = ring_down(bench(), ContactLaw("linear", PRELOAD), pulse, 1.1e-5, 1000, RATE)
    assert np.all(worst(ours, exact) < 1e-9)


@pytest.mark.parametrize("law", ["linear", "hertz", "exponential"])
@pytest.mark.parametrize("can_part", [False, True])
@pytest.mark.parametrize("peak_n", [0.3, 2.0])
def test_nonlinear_law_agrees_with_located_events(law, can_part, peak_n):
    pulse = half_sine(peak_n, 3e-4)
    theirs = reference(bench(), law, can_part, pulse, 5.27e-5)
    ours = ring_down(bench(), ContactLaw(law, PRELOAD, can_part), pulse, 5.27e-5, SAMPLES, RATE, FILTER)
    assert np.all(worst(ours, theirs) < 1e-8)
    if can_part and peak_n > 1 and law != "exponential":
        assert np.sum(ours.contact_force == -PRELOAD) > 5


@pytest.mark.parametrize(("law", "zeta"), [("hertz", 0.2), ("linear", 0.2), ("exponential", 0.02)])
def test_heavy_damping_and_parting_agree_with_located_events(law, zeta):
    pulse = sampled([0, 5e-5, 1.3e-4, 3e-4], [0, 6, 3, 0])
    theirs = reference(bench(zeta), law, True, pulse, 1e-5)
    ours = ring_down(bench(zeta), ContactLaw(law, PRELOAD, True), pulse, 1e-5, SAMPLES, RATE, FILTER)
    assert np.min(theirs[2]) == pytest.approx(-PRELOAD)
    assert np.all(worst(ours, theirs) < 1e-8)


def test_undamped_contact_that_parts_keeps_its_energy():
    t = TwoMass(0.107, 0.108, 0.5379e6, 0.54e6, 7.5e6, 0.0)
    r = ring_down(t, ContactLaw("hertz", PRELOAD, True), half_sine(2.0, 3e-4), 0.0, 4000, RATE)
    # v2 from the displacement would be approximate: use instants at which the lower mass rests, by energy's bound
    delta0 = 1.5 * PRELOAD / t.kc
    delta = np.maximum(delta0 + r.approach, 0.0)
    stored = 0.4 * PRELOAD / delta0**1.5 * delta**2.5 - PRELOAD * r.approach - 0.4 * PRELOAD * delta0
    fine = ring_down(t, ContactLaw("hertz", PRELOAD, True), half_sine(2.0, 3e-4), 0.0, 64000, 16 * RATE)
    v2 = np.gradient(fine.lower_displacement, 1 / (16 * RATE), edge_order=2)[::16]
    v1 = v2 + r.approach_rate
    x1 = r.lower_displacement + r.approach
    kinetic = (t.m1 * v1**2 + t.m2 * v2**2) / 2
    energy = kinetic + (t.k1 * x1**2 + t.k2 * r.lower_displacement**2) / 2 + stored
    assert np.sum(r.contact_force == -PRELOAD) > 100
    assert energy[20:-20] == pytest.approx(energy[100], rel=2e-4)


def test_small_taps_cannot_tell_the_laws_apart():
    pulse = half_sine(1e-6, 3e-4)
    linear = ring_down_linear(bench(), pulse, 0.0, 500, RATE, FILTER).acceleration
    for law in ("hertz", "exponential"):
        ours = ring_down(bench(), ContactLaw(law, PRELOAD, True), pulse, 0.0, 500, RATE, FILTER).acceleration
        assert np.max(np.abs(ours - linear)) < 1e-4 * np.max(np.abs(linear))


def test_contact_that_can_part_never_pulls():
    r = ring_down(bench(), ContactLaw("linear", PRELOAD, True), half_sine(5.0, 3e-4), 0.0, 2000, RATE)
    assert np.min(r.contact_force) == -PRELOAD


def test_tighter_tolerance_changes_nothing_that_matters():
    law, pulse = ContactLaw("exponential", PRELOAD), half_sine(1.0, 3e-4)
    ours = ring_down(bench(), law, pulse, 1e-5, 5000, RATE, FILTER)
    tight = ring_down(bench(), law, pulse, 1e-5, 5000, RATE, FILTER, tolerance=1e-14)
    assert np.all(worst(ours, columns(tight)) < 1e-8)


def test_a_contact_too_stiff_to_compute_is_told():
    with pytest.raises(RigError, match="could not be computed"):
        ring_down(bench(), ContactLaw("exponential", 1e-4), half_sine(1e6, 3e-4), 0.0, 10, RATE)
