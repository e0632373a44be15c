"""What a resonance pays for being found anywhere, and where a law may act as well: three springs, one sensor."""

from __future__ import annotations

import math
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.mismatch.diagnosis import Diagnosis, diagnose_recordings
from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import SelectionPolicy
from analysis.mismatch.recordings.costs import cost_of
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.kinds import Scale
from tests.analysis.mismatch.recordings.described_rigs import motion, recorded
from tests.analysis.terms import listed

MASS = np.array([1.35, 0.82])
STIFFNESS = np.array([[7.4e3, -2.3e3], [-2.3e3, 9.7e3]])
DAMPING = np.array([[0.48, -0.17], [-0.17, 0.37]])
CUBED, RATE = 1.2e5, 250.0
TRIPLE = """
bodies: {left: 1.35, right: 0.82}
springs:
- {name: wall left, between: [left, ground], stiffness: unknown, damping: unknown}
- {name: middle, between: [right, left], stiffness: unknown, damping: unknown}
- {name: wall right, between: [right, ground], stiffness: unknown, damping: unknown}
sensors: [{channel: 0, of: right, shows: acceleration, unit: m/s2}]
"""


@pytest.mark.parametrize(
    ("hz", "ratio", "count"),
    [(20.0, 0.05, math.log(600) / 0.1), (20.0, 1e-6, math.log(600) * 20 * 6), (20.0, 30.0, 1.0)],
    ids=["as wide as it is damped", "as wide as the recording is short", "wider than the band"],
)
def test_a_resonance_pays_for_as_many_as_there_are_in_the_band(hz: float, ratio: float, count: float) -> None:
    omega = 2 * math.pi * hz
    values = (1e-3, 1e-3 * omega**2, 2 * ratio * 1e-3 * omega)
    term = Term(listed("attached_mass"), dict(zip(listed("attached_mass").body, values, strict=True)), (0,))
    scale = Scale(1.0, 1.0, 0.0, 1.0, (10.0, 80.0), 6.0, 1.0, 100.0)
    problem = SimpleNamespace(policy=SelectionPolicy(parameter_cost=2.0), scale_of=lambda fitted, place: scale)
    fitted: Any = SimpleNamespace(problem=problem)
    assert cost_of(fitted, term) == pytest.approx(6 + 2 * math.log(count), rel=1e-12)


def test_what_has_no_resonance_pays_for_its_parameters_alone() -> None:
    fitted: Any = SimpleNamespace(problem=SimpleNamespace(policy=SelectionPolicy(parameter_cost=2.0)))
    assert cost_of(fitted, Term(listed("tube_spring_cubic"), {"cubic_stiffness_n_per_m3": 1.0}, (0,))) == 2.0


@cache
def diagnosed(element: int) -> Diagnosis:
    """Return the answer to two decays of the rig with a weak cubic spring as one of the three."""
    pulls = np.array([[1.0, 0.0], [-1.0, 1.0], [0.0, 1.0]])[element]

    def rest(s: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -np.asarray((STIFFNESS @ x + DAMPING @ v + pulls * CUBED * (pulls @ x) ** 3) / MASS)

    decays: list[Recording] = []
    for seed, start in enumerate(([0.004, -0.0015, 0.05, 0.2], [0.001, 0.003, -0.2, -0.1])):
        y = motion(rest, start, 3000, RATE)
        right = np.array([rest(0.0, x, v)[1] for x, v in zip(y[:2].T, y[2:].T, strict=True)])
        decays.append(recorded([right], RATE, 0.01, seed=seed))
    known = [listed("attached_mass"), listed("tube_spring_cubic"), listed("quadratic_damping")]
    return diagnose_recordings(decays, parse_rig(TRIPLE), known, learn=False)


@pytest.mark.slow
def test_a_weak_cubic_spring_is_no_part_tuned_to_the_rigs_mode() -> None:
    (named,) = diagnosed(1).answer.mechanisms
    assert named.id == "tube_spring_cubic"
    assert "middle" in named.statement


@pytest.mark.slow
def test_where_a_law_may_act_as_well_is_said() -> None:
    (named,) = diagnosed(2).answer.mechanisms
    assert named.id == "tube_spring_cubic"
    assert "It may as well be at " in named.statement
    assert "wall right" in named.statement
    assert named.statement.endswith(": these recordings do not tell which.")
