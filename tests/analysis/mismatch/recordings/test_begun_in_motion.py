"""What was before a recording begins and is remembered: by a filter that ran already, by a spring that relaxes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import fit
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.made_ready import weighed
from analysis.mismatch.recordings.recorded import prepare
from mesotap.configuration.rig_files import parse_rig
from tests.analysis.mismatch.recordings.described_rigs import INPUT, RATE, SPRING, driven, recorded
from tests.analysis.terms import listed

BEGUN, CORNER_HZ, BEFORE = 700, 2.5, -1.0  # a time constant of 13 samples


def passed(x: np.ndarray, before: float) -> np.ndarray:
    """Return rows (n,) through a low-pass that holds so many rms of them at the first sample."""
    t, rate = np.arange(x.size) / RATE, 2 * np.pi * CORNER_HZ
    between = CubicSpline(t, x)
    found = solve_ivp(
        lambda s, z: rate * (between(s) - z), (0, t[-1]), [before * x.std()], t_eval=t, rtol=1e-9, atol=1e-12
    )
    return np.asarray(found.y[0])


@pytest.mark.parametrize("before", [0.0, BEFORE])
def test_a_filter_that_ran_before_the_recording_leaves_nothing_behind(before: float) -> None:
    u, x, _ = (row[BEGUN:] for row in driven())
    rig = parse_rig(SPRING + INPUT + "sensors: [{channel: 1, of: mass, shows: displacement}]\n")
    known = [listed("undeclared_filter"), listed("channel_skew")]
    answer = diagnose_recordings([recorded([u, passed(x, before)], RATE, 2e-3)], rig, known, learn=False).answer
    assert [m.id for m in answer.mechanisms] == ["undeclared_filter"]
    corner = answer.mechanisms[0].parameters["corner_hz"]
    assert corner.value == pytest.approx(CORNER_HZ, rel=0.01)
    assert answer.remainder.p_value > 0.01


LATER = 7  # samples after the release, that a recording begins
MASS, STIFFNESS, DAMPING, RELAXING, TIME = 1.0, 3000.0, 0.8, 600.0, 0.02


@pytest.mark.parametrize("later", [0, LATER])
def test_a_spring_that_relaxes_carries_what_was_before_the_recording(later: int) -> None:
    def slope(t: float, z: np.ndarray) -> list[float]:
        x, v, f = z
        return [v, -(STIFFNESS * x + DAMPING * v + f) / MASS, RELAXING * v - f / TIME]

    t = np.arange(1200 + later) / RATE
    moved = solve_ivp(slope, (0, t[-1]), [0.01, 0.0, 0.0], t_eval=t, method="DOP853", rtol=1e-10, atol=1e-14).y
    rig = parse_rig(
        f"bodies: {{mass: {MASS}}}\n"
        f"springs: [{{between: [mass, ground], stiffness: {STIFFNESS}, damping: {DAMPING}}}]\n"
        "sensors: [{channel: 0, of: mass, shows: displacement}]\n"
    )
    prepared = prepare(recorded([moved[0, later:]], RATE, 1e-2), rig)
    first = t.size - later - prepared.samples  # of a decay's samples, that are left out
    relaxation = listed("relaxation")
    with np.errstate(all="ignore"):
        problem = problem_of(rig, [prepared])
        linear = linear_fit(weighed(linear_fit(problem)))
        term = Term(relaxation, {"relaxing_stiffness_n_per_m": 300.0, "relaxation_time_s": 0.03}, (0,))
        found = fit(linear.problem, (term,), linear, fine=True)
    errors = np.sqrt(np.diag(found.term_covariances[0]))  # of the stiffness, of the logarithm of the time
    (fitted,) = found.terms
    assert abs(fitted.values["relaxing_stiffness_n_per_m"] - RELAXING) < 3 * errors[0]
    assert abs(np.log(fitted.values["relaxation_time_s"] / TIME)) < 3 * errors[1]
    assert errors[1] < 0.2
    before = moved[2, later + first]
    assert found.own[0].memory == pytest.approx([before], abs=0.1 * np.abs(moved[2]).max())
    assert found.scatter < 1.3
