"""Dry friction that holds a body and turns it about, against motions in closed form and from event to event."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue
from sim_backend.propagate import Clock, Given, Motion, Rigs, laws_of, propagate
from tests.sim_backend.exact_friction import exact_motion

MASS, STIFFNESS, FRICTION = 0.9, 5200.0, 4.0
# N; the second step is too small to let it go; after none does it stop where friction just holds it, which has no slope
LEVELS = np.array([30.0, -12.3, -14.5, 25.0, 25.0, -30.0])
RATE, HELD, SUBSTEPS = 2000.0, 800, 3
OMEGA = math.sqrt(STIFFNESS / MASS)


def closed_form() -> Real:
    """Return (n, 2) states: cosines about where spring and friction balance, half a period each, until it sticks."""
    out, x = [], 0.0
    at = np.arange(HELD) / RATE
    for level in LEVELS:
        states, t = np.tile([x, 0.0], (HELD, 1)), 0.0
        while abs(level - STIFFNESS * x) > FRICTION:
            centre = (level - math.copysign(FRICTION, level - STIFFNESS * x)) / STIFFNESS
            moving, phase = at >= t, OMEGA * (at - t)
            states[moving, 0] = centre + (x - centre) * np.cos(phase[moving])
            states[moving, 1] = -(x - centre) * OMEGA * np.sin(phase[moving])
            x, t = 2 * centre - x, t + math.pi / OMEGA
            states[at >= t] = x, 0.0
        assert t < HELD / RATE
        out.append(states)
    return np.concatenate(out)


def propagated(rounding: float, substeps: int = SUBSTEPS, tolerance: float = 1e-5) -> Motion:
    h = 1 / RATE / substeps
    law = catalogue()["guide_friction"][0].law
    laws = laws_of([(law, 0)], [[np.array([0.0, 0.0, 0.0, h, FRICTION, rounding])]], [True])
    rigs = Rigs(*(np.array([p]) for p in ([MASS], [[0.0]], [[STIFFNESS]], [[1.0]], [[1.0]])))
    push = np.repeat(LEVELS, HELD)[None, None]
    steps = (push.size - 1) * substeps
    given = Given(push, push, 0 * push, substeps)
    clock = Clock(np.zeros(1), h, steps, substeps)
    return propagate(rigs, laws, np.zeros((1, 2)), clock, given, None, tolerance, keeps_division=True)


@pytest.mark.parametrize("rounding", [1e-6, 1e-7, 1e-9])  # m/s, of some 0.5 m/s
def test_a_body_that_sticks_stays_and_slides_as_in_closed_form(rounding: float) -> None:
    exact, found = closed_form(), propagated(rounding)
    size = np.abs(exact).max(axis=0)
    assert np.abs(found.states[0] - exact).max(axis=0) / size == pytest.approx([0.0, 0.0], abs=2e-4)
    stuck = (exact[:, 1] == 0.0) & (np.arange(len(exact)) % HELD > 0)
    assert np.count_nonzero(stuck) > 0.3 * stuck.size
    held = np.repeat(LEVELS, HELD) - STIFFNESS * exact[:, 0]
    np.testing.assert_allclose(found.forces[0, 0, ::SUBSTEPS][stuck], held[stuck], atol=1e-2 * FRICTION)


def test_what_is_held_is_not_divided_into_short_steps() -> None:
    found = propagated(1e-7)
    steps = found.forces.shape[2] - 1
    short = np.trim_zeros(found.division[0], "b").size
    assert short < 1.3 * steps


BLOCKS = np.array([1.2, 0.7]), np.array([[18.3, -12.3], [-12.3, 12.3]]), np.array([[211e3, -135e3], [-135e3, 135e3]])
TURNING_SAMPLES, TURNING_SUBSTEPS = 3000, 6


def shaking() -> np.ndarray:
    """Return (2 n - 1,) a force of twenty lines at every half substep: the joint sticks and turns 80 times a second."""
    random = np.random.default_rng(158)
    t = np.arange(2 * (TURNING_SAMPLES - 1) * TURNING_SUBSTEPS + 1) / RATE / TURNING_SUBSTEPS / 2
    lines = random.uniform(4, 90, 20)
    return 5.0 * np.cos(2 * np.pi * np.outer(t, lines) + random.uniform(0, 2 * np.pi, 20)).sum(axis=1) / math.sqrt(10)


@pytest.mark.parametrize(("rounding", "off"), [(1e-6, 1.5e-4), (1e-8, 3e-5)])  # m/s, of some 0.1 m/s
def test_a_joint_that_sticks_and_turns_about_moves_as_from_event_to_event(rounding: float, off: float) -> None:
    force, rubs, h = shaking(), np.array([-1.0, 1.0]), 1 / RATE / TURNING_SUBSTEPS
    exact = exact_motion(BLOCKS, np.array([0.0, 1.0]), rubs, FRICTION, force, h)[::TURNING_SUBSTEPS]
    rate = exact[:, 2:] @ rubs
    assert np.count_nonzero(np.diff(np.sign(rate)) != 0) > 80  # it turns about and sticks often
    assert 0.05 < np.mean(np.abs(rate) < 1e-12) < 0.5
    mass, damping, stiffness = BLOCKS
    law = catalogue()["guide_friction"][0].law
    laws = laws_of([(law, 0)], [[np.array([0.0, 0.0, 0.0, h, FRICTION, rounding])]], [True])
    rigs = Rigs(mass[None], damping[None], stiffness[None], rubs[None, None], np.array([[[0.0], [1.0]]]))
    begin, middle, end = force[:-2:2], force[1::2], force[2::2]
    given = Given(begin[None, None], end[None, None], (2 * (begin + end) - 4 * middle)[None, None], 1)
    clock = Clock(np.zeros(1), h, len(begin), TURNING_SUBSTEPS)
    states = propagate(rigs, laws, np.zeros((1, 4)), clock, given, None, 1e-5).states[0]
    size = np.sqrt(np.mean(exact**2, axis=0))
    assert np.all(np.sqrt(np.mean((states - exact) ** 2, axis=0)) < off * size)
