"""A channel that remembers what was before a recording begins: a filter that ran already."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from analysis.mismatch.diagnosis import diagnose_recordings
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
