"""Free decays after taps that last: they begin once the rig is free."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.recordings.impact_over import after_the_impact, is_free
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.made_ready import made_ready
from analysis.mismatch.recordings.recorded import prepare
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue, variants

RATE, SAMPLES, FINE, STRUCK_S = 2000.0, 5000, 20, 0.08
MASSES = np.array([0.8, 0.35])
STIFFNESS = np.array([[9e4 + 1.6e5, -1.6e5], [-1.6e5, 1.6e5]])
DAMPING = np.array([[3.5, -2.0], [-2.0, 2.0]])
RIG = parse_rig("""
bodies: {block: 0.8, cap: 0.35}
springs: [{name: tube, between: [block, ground], damping: unknown}]
joints: [{name: glue, between: [cap, block]}]
sensors:
- {channel: block, of: block, shows: acceleration}
- {channel: cap, of: cap, shows: acceleration}
""")


@cache
def struck(width_s: float, hum: float = 0.0, seed: int = 1) -> Recording:
    """Return accelerations after a tap on the block with a Gaussian force of this width, by the matrix exponential."""
    t = np.arange(SAMPLES * FINE) / (RATE * FINE)
    force = np.exp(-0.5 * ((t - STRUCK_S) / width_s) ** 2) * 0.05 / (width_s * np.sqrt(2 * np.pi))
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS / MASSES[:, None], -DAMPING / MASSES[:, None]]])
    push = np.array([0, 0, 1 / MASSES[0], 0])
    step, carried = expm(a / (RATE * FINE)), np.linalg.solve(a, expm(a / (RATE * FINE)) - np.eye(4)) @ push
    z, rows = np.zeros(4), np.empty((2, SAMPLES))
    for i in range(t.size):
        if i % FINE == 0:
            rows[:, i // FINE] = (a @ z + push * force[i])[2:]
        z = step @ z + carried * (force[i] + force[min(i + 1, t.size - 1)]) / 2
    random, at = np.random.default_rng(seed), t[::FINE]
    rows = rows + 3e-3 * rows.std(axis=1, keepdims=True) * random.normal(size=rows.shape)
    return Recording(rows + hum * np.sin(2 * np.pi * 50 * at + 0.3), RATE, ("block", "cap"), "", "decay")


def constants(recording: Recording) -> tuple[Real, int]:
    """Return stiffnesses and dampings of the linear rig's fit once a recording is made ready, and what was left out."""
    problem = made_ready(problem_of(RIG, [prepare(recording, RIG)]), ())
    values = linear_fit(problem).values
    names = ("stiffness of tube", "stiffness of glue", "damping of tube", "damping of glue")
    return np.array([values[name] for name in names]), problem.recordings[0].struck


@pytest.mark.parametrize("width_s", [4e-4, 8e-4, 2e-3])
def test_a_decay_begins_when_the_tap_is_over(width_s: float) -> None:
    recording = struck(width_s)
    raw = linear_fit(problem_of(RIG, [prepare(recording, RIG)]))
    found, left_out = constants(recording)
    assert is_free(raw) == (left_out == 0)
    np.testing.assert_allclose(found, [9e4, 1.6e5, 1.5, 2.0], rtol=3e-3)


def test_what_is_struck_for_long_is_seen_and_what_is_struck_briefly_stays_as_it_is() -> None:
    brief, long = (linear_fit(problem_of(RIG, [prepare(struck(w), RIG)])) for w in (1e-4, 8e-4))
    assert after_the_impact(brief)[0] is brief.problem.recordings[0]
    (cut,), (whole,) = after_the_impact(long), long.problem.recordings
    assert cut.struck > 0
    assert cut.samples == whole.samples - cut.struck
    np.testing.assert_array_equal(cut.outputs, whole.outputs[:, cut.struck :])
    assert cut.start_s == pytest.approx(whole.start_s + cut.struck / RATE)
    assert cut.rang_s == pytest.approx(whole.rang_s + cut.struck / RATE)


def test_what_rings_on_beside_the_rig_does_not_hide_that_it_is_free() -> None:
    """A decay of an undescribed part had kept it from beginning later: it is loudest at its beginning, too."""
    tapped = struck(8e-4)
    since = np.arange(SAMPLES) / RATE - STRUCK_S - 4 * 8e-4
    part = 0.02 * np.exp(-6 * np.maximum(since, 0)) * np.sin(2 * np.pi * 91 * since) * (since > 0)
    ringing = Recording(tapped.data + part * np.abs(tapped.data).max(), RATE, tapped.names, "", "decay")
    assert made_ready(problem_of(RIG, [prepare(ringing, RIG)]), ()).recordings[0].struck == constants(tapped)[1] > 0


def test_a_recording_without_silence_before_begins_where_it_did_and_one_beside_it_when_it_is_free() -> None:
    """What is missed by more at the beginning of a decay may be the rig: nothing tells that it was struck."""
    whole = struck(8e-4)
    begun = Recording(whole.data[:, round(STRUCK_S * RATE) :], RATE, whole.names, "", "decay")
    linear = linear_fit(problem_of(RIG, [prepare(begun, RIG), prepare(whole, RIG)]))
    first, second = after_the_impact(linear)
    assert first is linear.problem.recordings[0]
    assert second.struck > 0
    left_out = [r.struck for r in made_ready(linear.problem, ()).recordings]
    assert left_out[0] == 0
    assert left_out[1] > 0


@pytest.mark.slow
def test_hum_beside_a_long_tap_is_named_alone_and_the_tap_told() -> None:
    """The end of the tap had been an attached part of 2e-10 kg beside the hum (0.80)."""
    answer = diagnose_recordings([struck(8e-4, hum=0.15)], RIG, variants(catalogue())).answer
    assert [m.id for m in answer.mechanisms] == ["mains_hum"]
    assert (
        answer.mechanisms[0].parameters["amplitude_m_s2"].low
        < 0.15
        < answer.mechanisms[0].parameters["amplitude_m_s2"].high
    )
    assert "was still struck" in answer.set_aside[0].statement
