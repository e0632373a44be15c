"""What held-out errors far over the noise do to a name; recordings by SciPy's own integrators."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.recordings.blocks import missed_still, over_noise, predicts_no_better
from analysis.mismatch.recordings.fit import SimulatedFit, fit, linear_fit, problem_of
from analysis.mismatch.recordings.recorded import prepare
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.described_rigs import (
    INPUT,
    RATE,
    SAMPLES,
    SPRING,
    duffing,
    motion,
    noise_input,
    sensor,
)
from tests.analysis.terms import at_work

PENDULUM = """
bodies: {bob: 1}
pendulums: [{name: pivot, between: [bob, ground]}]
sensors: [{channel: 0, of: bob, shows: displacement}]
"""
W, DAMPING, FRICTION, DRAG = 5.65, 0.03, 0.1, 0.05  # rad/s, N s/m, N, N s2/m2
SWINGS, SLOW = 0.8, 0.4
STICKS = 2e-4  # m/s, over which the friction turns
QUANTUM = 2 * math.pi / 4096


@functools.cache
def fits() -> tuple[SimulatedFit, SimulatedFit]:
    """Return the linear rig fitted to a spring with a cube, and the rig with that cube."""
    recording = duffing(noise_input(SAMPLES, RATE, 2, 25, seed=3))
    rig = parse_rig(SPRING + INPUT + sensor("velocity"))
    linear = linear_fit(problem_of(rig, [prepare(recording, rig)]))
    cubic = at_work("tube_spring_cubic", {"cubic_stiffness_n_per_m3": 4e4})
    term = type(cubic)(cubic.mechanism, cubic.values, (0,))
    return linear, fit(linear.problem, (term,), linear)


@pytest.mark.slow
def test_what_is_missed_far_over_the_noise_is_the_share_of_held_out_errors() -> None:
    linear, named = fits()
    assert over_noise(named) < 1.5
    assert missed_still(linear, named) == 0.0
    assert over_noise(linear) > 10
    assert missed_still(linear, linear) == pytest.approx(1 - over_noise(linear) ** -2, rel=1e-9)


@pytest.mark.slow
def test_a_fit_with_larger_held_out_errors_predicts_no_better() -> None:
    linear, named = fits()
    assert not predicts_no_better(linear, named)
    assert predicts_no_better(named, linear)


def decay(begin: float, friction: float = 0.0, drag: float = 0.0) -> Recording:
    """Return a pendulum of large swings that rubs or is held back by drag, by an encoder."""

    def rest(s: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -(W**2) * np.sin(x) - DAMPING * v - friction * np.tanh(v / STICKS) - drag * v * np.abs(v)

    x, _ = motion(rest, [begin, 0.0], 3000, 100.0)
    return Recording(QUANTUM * np.round(x / QUANTUM)[None], 100.0, ("angle",), "", "simulated")


@pytest.mark.long
def test_two_effects_that_a_third_resembles_are_both_named() -> None:
    said: list[str] = []
    recorded = [decay(SWINGS, friction=FRICTION), decay(SLOW, friction=FRICTION)]
    found = diagnose_recordings(recorded, parse_rig(PENDULUM), variants(catalogue()), said.append)
    named = {m.id: m.parameters for m in found.answer.mechanisms}
    assert set(named) == {"tube_spring_cubic", "guide_friction"}
    (force,) = named["guide_friction"].values()
    assert force.value == pytest.approx(FRICTION, rel=0.02)
    assert [line for line in said if line.startswith("beginning again without")]


@pytest.mark.long
def test_two_effects_that_several_others_resemble_are_both_named() -> None:
    said: list[str] = []
    found = diagnose_recordings([decay(1.0, drag=DRAG)], parse_rig(PENDULUM), variants(catalogue()), said.append)
    named = {m.id: m.parameters for m in found.answer.mechanisms}
    assert set(named) == {"tube_spring_cubic", "quadratic_damping"}
    (drag,) = named["quadratic_damping"].values()
    assert drag.value == pytest.approx(DRAG, rel=0.03)
    again = [line for line in said if line.startswith("beginning again without")]
    assert any("attached mass" in line and "frame compliance" in line for line in again)
