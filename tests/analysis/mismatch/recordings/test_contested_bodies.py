"""A part that rings by itself makes up for the harmonics of a law in free decays; a learned law contests it."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.recordings.costs import lead_of, rings_at_a_harmonic
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.selection import screened_baseline
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.described_rigs import motion

RATE, SAMPLES, OMEGA = 400.0, 3000, 2 * np.pi * 18
RIG = parse_rig(
    "bodies: {m: 1}\njoints: [{name: leaf, between: [m, ground]}]\nsensors: [{channel: x, of: m, shows: velocity}]\n"
)


def rubbing() -> Recording:
    """Return the decay of a leaf whose friction grows with its deflection: it has third harmonics at any amplitude."""

    def rest(_: float, x: Real, v: Real) -> Real:
        return -(OMEGA**2) * (x + 0.004 * np.abs(x) * np.sign(v)) - 0.008 * OMEGA * v

    v = motion(rest, [0.0, 1.0], SAMPLES, RATE)[1]
    noisy = v + 2e-4 * v.std() * np.random.default_rng(3).normal(size=SAMPLES)
    return Recording(noisy[None], RATE, ("x",), "", "made")


@pytest.mark.slow
def test_a_part_that_rings_at_a_multiple_of_a_mode_is_seen_to() -> None:
    problem = problem_of(RIG, [prepare(rubbing(), RIG)])
    judge = BlockJudge.of(problem, [*catalogue()["attached_mass"], *catalogue()["tube_spring_cubic"]])
    baseline = screened_baseline(judge)
    part, cube = (
        judge.fitted_alone(baseline.current, [s for s in baseline.screening.scores if s.term.mechanism.id == name][:1])
        for name in ("attached_mass", "tube_spring_cubic")
    )
    assert part is not None
    assert cube is not None
    assert rings_at_a_harmonic(part)
    assert not rings_at_a_harmonic(cube)
    assert not rings_at_a_harmonic(baseline.current)
    assert lead_of(part, cube) > 100
    assert lead_of(part, cube) == pytest.approx(-lead_of(cube, part))


@pytest.mark.long
def test_a_friction_that_grows_with_the_deflection_is_no_frame() -> None:
    """It was `frame_compliance` (0.45), which left nothing beyond noise."""
    answer = diagnose_recordings([rubbing()], RIG, variants(catalogue())).answer
    assert answer.verdict == "new_physics"
    (learned,) = answer.mechanisms
    assert learned.law is not None
    assert (learned.element, learned.law.kind) == ("leaf", "rate")
    exponent = learned.law.exponents["deflection"]
    assert exponent is not None
    assert exponent.low < 1.0 < exponent.high
    assert learned.law.formulas[0].text.endswith("sign(v)")
    assert learned.probability > 0.9
