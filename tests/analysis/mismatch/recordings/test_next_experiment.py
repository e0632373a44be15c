"""What to record next where no listed mechanism explains: another strength, or where that was done another sensor."""

from __future__ import annotations

import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
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
