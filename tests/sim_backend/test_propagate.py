"""Rigs with extra forces carried along: against scipy's DOP853, closed forms, energy and time reversed."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from sim_backend.force_law import SLOTS, no_law
from sim_backend.mechanisms.catalogue import catalogue
from sim_backend.propagate import Clock, Given, Impact, Motion, Rigs, laws_of, propagate
from sim_backend.propagate.exact_step import phi_functions
from tests.sim_backend.motions import (
    DAMPING,
    PRELOAD,
    RATE_HZ,
    SAMPLES,
    SPEED,
    STIFFNESS,
    TWO,
    Case,
    cases,
    error,
    motion,
    reference,
)

CASES = cases()
BOUNDS = {  # of the error in four substeps, over the largest displacement
    "smooth law": 3e-5,
    "contact loss": 1e-3,
    "end stop": 2e-4,
    "dry friction": 1e-5,
    "hysteresis": 2e-4,
    "rate law": 4e-4,
    "added body": 3e-5,
    "input linear": 1e-4,
    "input band-limited": 1e-4,
    "second impact": 1e-4,
}
NOTHING = laws_of([], [[]])


@pytest.mark.parametrize("name", BOUNDS)
def test_four_substeps_are_as_good_as_bounded(name: str) -> None:
    case = CASES[name]
    assert error(case, motion(case, 4), reference(case)) < BOUNDS[name]


@pytest.mark.long
def test_a_held_input_is_as_good_as_bounded() -> None:
    case = CASES["input held"]
    assert error(case, motion(case, 4), reference(case)) < 2e-4


def test_the_error_of_undivided_steps_falls_with_their_third_power() -> None:
    case = CASES["smooth law"]
    true = reference(case)
    errors = [error(case, motion(case, substeps, np.inf), true) for substeps in (2, 4, 8, 16)]
    assert np.all(np.array(errors[:-1]) / errors[1:] > 6)


@pytest.mark.parametrize("name", ["contact loss", "end stop", "dry friction"])
def test_divided_steps_are_five_times_better_where_a_law_bends_abruptly(name: str) -> None:
    case = CASES[name]
    true = reference(case)
    assert error(case, motion(case, 2), true) < 0.2 * error(case, motion(case, 2, np.inf), true)


@pytest.mark.parametrize("size", [1e-3, 0.3, 20.0])
def test_phi_functions_are_blocks_of_a_larger_exponential(size: float) -> None:
    a = size * np.random.default_rng(1).normal(size=(4, 4))
    for level, found in enumerate(phi_functions(a, 3)):
        big = np.zeros((16, 16))
        big[:4, :4] = a / 4**level
        big[np.arange(12), np.arange(12) + 4] = 1.0
        blocks = expm(big)[:4].reshape(4, 4, 4).swapaxes(0, 1)
        np.testing.assert_allclose(found, blocks, atol=1e-10 * np.abs(blocks).max())


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 1e7), st.floats(0.0, 5e3), st.floats(-1.0, 1.0))
def test_a_linear_rig_moves_by_the_exponential_of_its_matrix(stiffness: float, damping: float, speed: float) -> None:
    mass = np.array([0.1, 0.3])
    k, c = (value * np.array([[1.0, -1.0], [-1.0, 1.0]]) for value in (stiffness, damping))  # free: a rigid-body mode
    rigs = Rigs(mass[None], c[None], k[None], np.zeros((1, 0, 2)), np.zeros((1, 2, 0)))
    start = np.array([1e-6, -2e-6, speed, 0.3])
    found = propagate(rigs, NOTHING, start[None], Clock(np.zeros(1), 1e-5, 300, 300)).states[0, -1]
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-k / mass[:, None], -c / mass[:, None]]])
    np.testing.assert_allclose(found, expm(3e-3 * a) @ start, rtol=0, atol=1e-9 * np.abs(start).max())


def test_a_given_parabola_moves_a_free_mass_by_its_double_integral() -> None:
    steps, h = 40, 1e-4
    t = h * np.arange(steps + 1)
    force = (3.0 + 200.0 * t + 5e4 * t**2)[None, None]
    bend = np.full((1, 1, steps), 5e4 * h**2)
    rigs = Rigs(np.array([[2.0]]), np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), np.zeros((1, 0, 1)), np.ones((1, 1, 1)))
    given_force = Given(force[..., :-1], force[..., 1:], bend, 1)
    found = propagate(rigs, NOTHING, np.zeros((1, 2)), Clock(np.zeros(1), h, steps, 1), given_force).states[0, :, 0]
    np.testing.assert_allclose(found, (3.0 * t**2 / 2 + 200.0 * t**3 / 6 + 5e4 * t**4 / 12) / 2, atol=1e-14)


def energy(states: np.ndarray) -> np.ndarray:
    """Energy of `TWO` without damping, its contact of Hertz."""
    mass, _, stiffness = TWO
    x, v = states[:, :2], states[:, 2:]
    d = x[:, 0] - x[:, 1]
    rest = 1.5 * PRELOAD / STIFFNESS
    contact = PRELOAD * (rest / 2.5 * np.maximum(1 + d / rest, 0.0) ** 2.5 - d)
    linear = 0.5 * np.einsum("ti,ij,tj->t", x, stiffness, x) - 0.5 * STIFFNESS * d**2
    return 0.5 * v**2 @ mass + linear + contact - PRELOAD * rest / 2.5


@settings(max_examples=20, deadline=None)
@given(st.floats(0.05, 2.5))
def test_an_elastic_contact_without_damping_keeps_the_energy(strength: float) -> None:
    mass, damping, stiffness = TWO
    undamped = (np.array([1.0, -1.0]), STIFFNESS, 0.0)
    smooth = CASES["smooth law"]
    case = replace(smooth, rig=(mass, 0 * damping, stiffness), speed=strength * SPEED, element=undamped)
    found = energy(motion(case, 8).states[0])
    np.testing.assert_allclose(found, found[0], rtol=2e-3)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(["smooth law", "contact loss", "end stop", "dry friction"]), st.floats(0.1, 1.5))
def test_a_motion_run_backward_returns_to_its_start(name: str, strength: float) -> None:
    case = replace(CASES[name], speed=strength * CASES[name].speed)
    substeps, mass = 16, case.rig[0]
    forward = motion(case, substeps).states[0]
    row, k, c = case.element
    h, samples = 1 / RATE_HZ / substeps, 60
    laws = laws_of([(case.law, 0)], [[np.array([PRELOAD, k, c, -h, *case.constants])]])
    rigs = Rigs(mass[None], case.rig[1][None], case.rig[2][None], row[None, None], np.zeros((1, 2, 0)))
    clock = Clock(np.array([samples / RATE_HZ]), -h, samples * substeps, substeps)
    back = propagate(rigs, laws, forward[samples][None], clock).states[0]
    size = np.abs(forward).max(axis=0)
    np.testing.assert_allclose(back / size, forward[samples::-1] / size, rtol=0, atol=2e-3)


def test_many_runs_together_are_the_same_alone() -> None:
    mass, damping, stiffness = TWO
    speeds = np.array([0.5, 1.0, 2.2]) * SPEED
    law = catalogue()["contact_loss"][0].law
    rows = [[np.array([PRELOAD, STIFFNESS, DAMPING, 1e-5])]] * 3
    start = np.zeros((3, 4))
    start[:, 2] = speeds

    def run(which: slice) -> np.ndarray:
        count = len(speeds[which])
        parts = (mass, damping, stiffness, np.array([[1.0, -1.0]]), np.zeros((2, 0)))
        rigs = Rigs(*(np.repeat(part[None], count, axis=0) for part in parts))
        clock = Clock(np.zeros(count), 1e-5, 500, 0)
        return propagate(rigs, laws_of([(law, 0)], rows[which]), start[which], clock).forces

    together = run(slice(None))
    assert np.abs(together[2]).max() > 0
    for i in range(3):
        assert np.array_equal(run(slice(i, i + 1))[0], together[i])


def test_bends_hold_the_impulse_of_the_extra_force() -> None:
    case: Case = CASES["contact loss"]
    coarse, fine = motion(case, 2), motion(case, 64)

    def impulse(substeps: int, found) -> np.ndarray:
        f, bend = found.forces[0, 0], found.bends[0, 0]
        return np.cumsum((f[:-1] + f[1:]) / 2 - bend / 6)[substeps * (SAMPLES // 8) - 1] / substeps

    assert impulse(2, coarse) == pytest.approx(impulse(64, fine), rel=2e-3)


def test_what_runs_away_ends_in_no_numbers() -> None:
    mass, _, stiffness = TWO
    rigs = Rigs(mass[None], -1e6 * np.eye(2)[None], stiffness[None], np.array([[[1.0, -1.0]]]), np.zeros((1, 2, 0)))
    laws = laws_of([(catalogue()["contact_loss"][0].law, 0)], [[np.array([PRELOAD, STIFFNESS, DAMPING, 1e-5])]])
    found = propagate(rigs, laws, np.array([[0.0, 0.0, 1.0, 0.0]]), Clock(np.zeros(1), 1e-4, 500, 1))
    assert np.isnan(found.states[0, -1]).all()
    assert np.isnan(found.forces[0, 0, -1])


def test_more_laws_than_can_act_together_are_refused() -> None:
    with pytest.raises(ValueError, match=f"no more than {SLOTS}"):
        laws_of([(no_law, 0)] * (SLOTS + 1), [[np.zeros(4)] * (SLOTS + 1)])


def rubbing(
    friction: float, substeps: int, tolerance: float = 1e-5, stiffness: float = 5200.0, **division: Any
) -> Motion:
    """Return a driven mass that rubs, with a sign rounded off to a thousandth of its speed, at 600 samples."""
    law, h, samples = catalogue()["guide_friction"][0].law, 5e-4 / substeps, 600
    laws = laws_of([(law, 0)], [[np.array([0.0, 0.0, 0.0, h, friction, 3e-4])]], [True])
    rigs = Rigs(*(np.array([p]) for p in ([0.9], [[1.5]], [[stiffness]], [[1.0]], [[1.0]])))
    t = np.arange((samples - 1) * substeps + 1) * h
    push = 9 * np.sin(70 * t) + 7 * np.sin(41 * t + 1)
    given_push = Given(push[None, None, :-1], push[None, None, 1:], 0 * push[None, None, 1:], 1)
    clock = Clock(np.zeros(1), h, (samples - 1) * substeps, substeps)
    return propagate(rigs, laws, np.array([[0.0, 0.4]]), clock, given_push, None, tolerance, **division)


def test_steps_divided_as_another_motion_s_give_the_same_motion_and_clean_differences() -> None:
    force, k, step = 4.0, 5200.0, 5e-3
    base = rubbing(force, 3, keeps_division=True)
    again = rubbing(force, 3, division=base.division)
    assert np.array_equal(again.states, base.states)
    near = (rubbing(force, 3, stiffness=k + step, division=base.division).states - base.states) / step
    ends = [rubbing(force, 256, np.inf, k + sign * step).states for sign in (1, -1)]
    fine = (ends[0] - ends[1]) / (2 * step)
    own = (rubbing(force, 3, stiffness=k + step).states - base.states) / step  # divided by its own errors
    off, off_alone = (np.linalg.norm(d - fine, axis=(0, 1)) / np.linalg.norm(fine, axis=(0, 1)) for d in (near, own))
    assert np.all(off < 1e-3)
    assert np.all(off_alone > 10 * off)  # else there is nothing to follow a division for


@settings(max_examples=20, deadline=None)
@given(st.floats(0.3, 3.0), st.floats(-0.5, 0.5))
def test_a_motion_that_follows_a_division_far_from_its_own_stays_near_its_own(force: float, change: float) -> None:
    division = rubbing(force, 3, keeps_division=True).division
    alone, found = rubbing(force * (1 + change), 3), rubbing(force * (1 + change), 3, division=division)
    size = np.abs(alone.states).max(axis=(0, 1))
    np.testing.assert_allclose(found.states / size, alone.states / size, rtol=0, atol=2e-3)


def test_a_division_of_another_motion_is_refused() -> None:
    division = rubbing(2.2, 3, keeps_division=True).division
    for other in (division[:, :-1], np.zeros((1, 0), np.int8), np.repeat(division, 2, axis=0)):
        with pytest.raises(ValueError, match="is not one of 1 motions of 1797 steps"):
            rubbing(2.2, 3, division=other)


def test_a_motion_is_computed_without_a_word_of_the_compiler() -> None:
    # numba warns where it looks at the types of force laws, and wraps the output each time if colorama is there;
    # threads wrapped what was wrapped, until a program that printed after a diagnosis ended in a recursion too deep
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rubbing(1.0, 1)


def test_arrays_of_any_layout_give_the_same_motion() -> None:
    runs, law = 3, catalogue()["tube_spring_cubic"][0].law
    parameters = [[np.array([0.0, 0.0, 0.0, 1e-4, 1e9 * (i + 1)])] for i in range(runs)]
    laws = laws_of([(law, 0)], parameters)
    rigs = Rigs(*(np.repeat([p], runs, axis=0) for p in ([0.9], [[1.5]], [[5200.0]], [[1.0]], [[1.0]])))
    start, clock = np.tile([1e-3, 0.4], (runs, 1)), Clock(np.zeros(runs), 1e-4, 400, 1)
    impact = Impact(np.array([100, 150, 200]), np.array([[0.0, 0.1], [0.0, 0.2], [0.0, 0.3]]))
    straight = propagate(rigs, laws, start, clock, None, impact)
    strided = np.zeros((2, *laws.parameters.shape[::-1]))
    strided[0] = laws.parameters.T
    turned = propagate(
        Rigs(*(np.asfortranarray(a) for a in rigs)),
        laws._replace(parameters=strided[0].T),
        np.asfortranarray(start),
        clock,
        None,
        Impact(np.repeat(impact.step, 2)[::2], np.asfortranarray(impact.jump)),
    )
    np.testing.assert_array_equal(turned.states, straight.states)
    assert len(np.unique(straight.states[:, -1, 0])) == runs
