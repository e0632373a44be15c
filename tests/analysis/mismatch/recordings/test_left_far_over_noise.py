"""What held-out errors far over the noise do to a name; recordings by SciPy's own integrators."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

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
W, DAMPING, FRICTION, DRAG, CUBED = 5.65, 0.03, 0.1, 0.05, 0.012  # rad/s, N s/m, N, N s2/m2, N s3/m3
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


Rest = Callable[[np.ndarray], np.ndarray]
HOLDS_BACK: dict[str, Rest] = {
    "guide_friction": lambda v: FRICTION * np.tanh(v / STICKS),
    "quadratic_damping": lambda v: DRAG * v * np.abs(v),
    "learned_rate": lambda v: CUBED * v**3,
}


def decays(what: str, begins: Sequence[float]) -> list[Recording]:
    """Return a pendulum of large swings that something holds back beside its linear damping, by an encoder."""

    def rest(s: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -(W**2) * np.sin(x) - DAMPING * v - HOLDS_BACK[what](v)

    moved = [motion(rest, [begin, 0.0], 3000, 100.0)[0] for begin in begins]
    return [Recording(QUANTUM * np.round(x / QUANTUM)[None], 100.0, ("angle",), "", "simulated") for x in moved]


@pytest.mark.long
@pytest.mark.parametrize(
    ("what", "size", "begins"),
    [
        ("guide_friction", FRICTION, (0.8, 0.4)),
        ("quadratic_damping", DRAG, (1.0,)),  # in one decay a change with time resembles both
        ("learned_rate", CUBED, (1.0, 0.5)),
    ],
)
def test_two_effects_that_another_resembles_are_both_named(what: str, size: float, begins: Sequence[float]) -> None:
    said: list[str] = []
    found = diagnose_recordings(decays(what, begins), parse_rig(PENDULUM), variants(catalogue()), said.append).answer
    named = {m.id: m for m in found.mechanisms}
    assert set(named) == {"large_swing", what}
    (arc,) = named["large_swing"].parameters.values()
    assert arc.value == pytest.approx(1.0, abs=2e-3)
    assert found.remainder is not None
    assert found.remainder.p_value > 0.01 or found.remainder.share < 1e-4  # an edge of friction is left
    if what == "learned_rate":
        law = named[what].law
        assert law is not None
        assert (law.kind, law.symmetry) == ("rate", "odd")
        power = law.exponents["rate"]
        assert power is not None
        assert power.low <= 3.0 <= power.high
        assert power.value == pytest.approx(3.0, abs=0.02)
    else:
        assert [v.value for v in named[what].parameters.values()] == pytest.approx([size], rel=5e-3)
    assert [line for line in said if line.startswith("beginning again without")]


@pytest.mark.long
def test_a_law_that_is_not_listed_is_learned_beside_one_that_is() -> None:
    cubic, unlisted = 1.25e6, 7500.0  # N/m3, N s/m3

    def rest(force: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return force - 2500.0 * x - 1.7 * v - cubic * x**3 - unlisted * x**2 * v

    force = 7.0 * noise_input(2400, 150.0, 1, 20, seed=11)
    x, _ = motion(rest, [0.0, 0.0], force.size, 150.0, force)
    seen = x + np.random.default_rng(5).normal(0.0, 1e-5, x.size)
    recording = Recording(np.array([force, seen]), 150.0, ("force", "position"), "", "simulated")
    rig = parse_rig(SPRING + INPUT.replace("gain: unknown", "offset: 0") + sensor("displacement"))
    found = diagnose_recordings([recording], rig, variants(catalogue()), lambda _: None)
    named = {m.id: m for m in found.answer.mechanisms}
    assert set(named) == {"tube_spring_cubic", "learned_rate"}
    (stiffness,) = named["tube_spring_cubic"].parameters.values()
    assert stiffness.value == pytest.approx(cubic, rel=0.01)
    law = named["learned_rate"].law
    assert law is not None
    power = law.exponents["deflection"]
    assert power is not None
    assert power.value == pytest.approx(2.0, abs=0.05)
