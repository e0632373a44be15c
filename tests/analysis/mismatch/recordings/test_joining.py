from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit, fit, linear_fit, problem_of
from analysis.mismatch.recordings.joining import SHARES, joined_to, not_astray
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.score_test import Score
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import family
from tests.analysis.mismatch.recordings.described_rigs import SPRING, motion, recorded, sensor

K, C, REACH = 5700.0, 1.2, 0.01
SOFTENING = -0.4 * K / REACH**2  # 40 % of the stiffness is gone where the decay begins; at 100 % there is no way back
(CUBIC,) = family("tube_spring_cubic")
NAME = "cubic_stiffness_n_per_m3"


@pytest.fixture(scope="module")
def linear() -> SimulatedFit:
    decay = motion(lambda u, x, v: -K * x - C * v - SOFTENING * x**3, [REACH, 0.0], 1500, 200.0)[0]
    rig = parse_rig(SPRING + sensor("displacement", 0))
    with np.errstate(all="ignore"):
        first = problem_of(rig, [prepare(recorded([decay], 200.0, 1e-3), rig)])
        return linear_fit(first.weighed(linear_fit(first)))


@pytest.mark.parametrize("times", [2.5, 4.0, 8.0])
def test_a_spring_that_would_soften_too_much_is_begun_weaker(linear: SimulatedFit, times: float) -> None:
    strong = Term(CUBIC, {NAME: times * SOFTENING}, (0,))
    begun = not_astray(linear.problem, linear, strong)
    assert abs(begun.values[NAME]) < abs(strong.values[NAME])
    assert begun.values[NAME] / strong.values[NAME] in SHARES
    score = Score(strong, 1e3, 1, 1.0, 0.0)
    found = joined_to(linear.problem, linear, score)
    assert found.terms[0].values[NAME] == pytest.approx(SOFTENING, rel=0.02)
    # the test can fail: from the full strength the motion has run away, and nothing leads back
    assert fit(linear.problem, (strong,), linear).scatter > 100 * found.scatter


def test_a_start_that_is_near_is_left_as_it_is(linear: SimulatedFit) -> None:
    slight = Term(CUBIC, {NAME: 0.05 * SOFTENING}, (0,))
    assert not_astray(linear.problem, linear, slight) == slight
