"""What to record next where no listed mechanism explains: another strength, or where that was done another sensor."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from analysis.mismatch.account import Weights
from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.next_experiment import _apart, is_linear
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.score_test import Score
from analysis.mismatch.selection import Candidate
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.kinds import Mechanism
from tests.analysis.mismatch.recordings.described_rigs import OMEGA, SPRING, motion, recorded
from tests.analysis.terms import listed

RATE, SAMPLES = 400.0, 1600
RIG = parse_rig(SPRING + "sensors: [{channel: 0, of: mass, shows: displacement}]\n")
KNOWN = [listed("quadratic_damping"), listed("guide_friction")]


def decay(strength: float) -> Recording:
    """Return the decay of a hardening spring."""
    y = motion(lambda s, x, v: -(OMEGA**2) * x * (1 + 0.05 * x**2) - 0.03 * OMEGA * v, [strength, 0.0], SAMPLES, RATE)
    return recorded([y[0]], RATE, 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strengths", "ratio", "moves"),
    [((1.0,), 0.5, ("tap",)), ((1.0, 0.8), 0.5, ("tap",)), ((1.0, 0.4), None, ("other_place",))],
)
def test_what_is_left_is_told_apart_by_strength_and_then_by_place(
    strengths: tuple[float, ...], ratio: float | None, moves: tuple[str, ...]
) -> None:
    answer = diagnose_recordings([decay(s) for s in strengths], RIG, KNOWN, learn=False).answer
    assert answer.remainder.p_value < 0.01
    then = answer.next_experiment
    assert then is not None
    assert (then.peak_force_ratio, then.moves) == (ratio, moves)
    assert then.separates[1] == "something else"


@cache
def judge() -> BlockJudge:
    with np.errstate(all="ignore"):
        return BlockJudge(problem_of(RIG, [prepare(decay(1.0), RIG)]), KNOWN)


def tried(mechanism: Mechanism) -> Candidate[SimulatedFit]:
    term = Term(mechanism, {q.name: 1.0 for q in mechanism.parameters}, (0,))
    return Candidate(Score(term, 9.0, 3, 1.0, 0.0), None, 9.0)


@pytest.mark.parametrize(("named", "ratio"), [("quadratic_damping", 1.5), ("frame_compliance", None)])
def test_strength_parts_two_unless_both_are_linear(named: str, ratio: float | None) -> None:
    part = listed("attached_mass")
    kinds = {part.id: part, named: listed(named)}  # what is named is no fit of the first step: it came in by exchange
    then = _apart(judge(), [named], [tried(part)], Weights({part.id: 1.0}, 2.0), kinds)
    assert then is not None
    assert then.peak_force_ratio == ratio


def test_an_explanation_that_is_not_linear_is_parted_first_though_a_linear_one_is_likelier() -> None:
    frame, part, cubic = (listed(name) for name in ("frame_compliance", "attached_mass", "tube_spring_cubic"))
    fits = [tried(m) for m in (part, frame, cubic)]
    weights = Weights({frame.id: 0.9, cubic.id: 0.8}, 3.0)
    then = _apart(judge(), [part.id], fits, weights, {m.id: m for m in (part, frame, cubic)})
    assert then is not None
    assert then.separates == (part.id, cubic.id)
    assert then.peak_force_ratio == 1.5


def test_a_sensor_s_fault_and_a_body_are_parted_by_exchanging_the_sensors() -> None:
    gain, rocking = listed("channel_gain"), listed("rocking")
    then = _apart(
        judge(), [rocking.id], [tried(gain)], Weights({gain.id: 1.0}, 2.0), {m.id: m for m in (gain, rocking)}
    )
    assert then is not None
    assert (then.peak_force_ratio, then.moves) == (None, ("swap_channels",))


@pytest.mark.parametrize(
    ("name", "linear"),
    [
        ("channel_gain", True),
        ("channel_skew", True),
        ("undeclared_filter", True),
        ("sensor_curvature", False),
        ("clipping", False),
        ("converter_step", False),
        ("attached_mass", True),
        ("guide_friction", False),
    ],
)
def test_what_is_in_proportion_to_the_motion_is_linear(name: str, linear: bool) -> None:
    assert is_linear(listed(name)) == linear
