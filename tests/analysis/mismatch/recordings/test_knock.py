"""A knock at a rig that is driven, which none of its inputs shows, against motions in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.blocks import predicts_no_better
from analysis.mismatch.recordings.impact_size import Struck, said_of, together
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.motion import with_impulse
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.recordings.second_impact import second_impact_score
from analysis.mismatch.rig_description import DescribedRig
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.kinds import SecondImpact
from sim_backend.propagate import Given
from tests.analysis.terms import listed

RATE, SAMPLES, NOISE = 500.0, 1600, 5e-3
MASSES, STIFFNESSES, DAMPINGS = (0.8, 0.5), (4100.0, 1900.0), (0.9, 0.7)


def rates(damping: float) -> NDArray[np.float64]:
    """Return (4, 4) the chain's slopes, with dampers so many times as strong."""
    k1, k2, c1, c2 = *STIFFNESSES, *(damping * c for c in DAMPINGS)
    stiff, loss = (np.array([[a + b, -b], [-b, b]]) for a, b in ((k1, k2), (c1, c2)))
    inertia = np.diag(MASSES)
    return np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(inertia, m) for m in (stiff, loss)]])


B = np.array([0, 0, 1 / MASSES[0], 0])
KNOWN = [listed("knock"), listed("tube_spring_cubic"), listed("contact_creep"), listed("frame_compliance")]


def rig(shown: str = "displacement") -> DescribedRig:
    return parse_rig(
        "bodies: {a: 0.8, b: 0.5}\n"
        "springs:\n  - {between: [a, ground], stiffness: unknown, damping: unknown}\n"
        "  - {between: [a, b], stiffness: unknown, damping: unknown}\n"
        "inputs: [{channel: F, force_on: a, gain: 1}]\n"
        f"sensors:\n  - {{channel: a, of: a, shows: {shown}}}\n  - {{channel: b, of: b, shows: {shown}}}\n"
    )


def driven(
    knocks: Sequence[tuple[float, int, float]], seed: int, shown: slice = slice(0, 2), damping: float = 1.0
) -> Recording:
    """Return a multisine's response in closed form, with impulses (s, body, N s)."""
    rng, t, a = np.random.default_rng(seed), np.arange(SAMPLES) / RATE, rates(damping)
    lines, phases = np.arange(1, 20, 0.5), rng.uniform(0, 2 * np.pi, 38)
    waves = np.exp(1j * (2 * np.pi * lines[:, None] * t + phases[:, None]))
    answers = np.array([np.linalg.solve(2j * np.pi * f * np.eye(4) - a, B) for f in lines])
    states = np.real(np.einsum("lk,ln->kn", answers, waves))
    for when, body, size in [*knocks, (-0.3, 1, 0.05)]:
        after = np.flatnonzero(t >= when)
        jump = size / MASSES[body] * np.eye(4)[2 + body]
        states[:, after] += np.array([expm(a * (t[i] - when)) @ jump for i in after]).T
    y = states[shown]
    y = y + NOISE * y.std(axis=1, keepdims=True) * rng.standard_normal(y.shape)
    return Recording(np.vstack([np.real(waves).sum(axis=0), y]), RATE, ("F", "a", "b"), "", f"knocked {seed}")


def impulse_of(recordings: Sequence[Recording], described: DescribedRig) -> NDArray[np.float64]:
    answer = diagnose_recordings(list(recordings), described, KNOWN, learn=False).answer
    assert [m.id for m in answer.mechanisms] == ["knock"]
    assert answer.remainder.p_value > 0.01
    found = answer.mechanisms[0].parameters["knock_impulse_n_s"]
    assert found.unit == "N s"
    return np.array([found.low, found.value, found.high])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("when", "body", "size"), [(0.7013, 1, 0.02), (1.301, 0, 0.05), (2.9, 1, 0.03), (1.9001, 0, 0.011)]
)
def test_a_knock_is_named_with_its_body_time_and_impulse(when: float, body: int, size: float) -> None:
    recording = driven([(when, body, size)], 3)
    answer = diagnose_recordings([recording], rig(), KNOWN, learn=False).answer
    assert [m.id for m in answer.mechanisms] == ["knock"]
    assert answer.mechanisms[0].element == "ab"[body]
    assert f"after {when:.4g} s" in answer.mechanisms[0].statement
    found = answer.mechanisms[0].parameters["knock_impulse_n_s"]
    assert found.low < size < found.high
    assert found.high - found.low < 0.15 * size
    assert answer.remainder.p_value > 0.01


@pytest.mark.slow
def test_of_velocities_and_where_only_one_of_two_recordings_was_knocked() -> None:
    recordings = [driven([], 5, slice(2, 4)), driven([(1.1111, 1, 0.03)], 6, slice(2, 4))]
    low, value, high = impulse_of(recordings, rig("velocity"))
    assert low < 0.03 < high
    assert value == pytest.approx(0.03, rel=0.05)


@pytest.mark.slow
def test_a_knock_that_has_died_out_before_anything_is_held_out() -> None:
    recording = driven([(0.955, 1, 0.0015)], 9, damping=20.0)
    low, _, high = impulse_of([recording], rig())
    assert low < 0.0015 < high


def test_what_was_held_out_says_nothing_of_what_happened_once_elsewhere() -> None:
    problem = problem_of(rig(), [prepare(driven([], 9), rig())])
    linear = linear_fit(problem)
    worse, far_worse = (replace(linear, x=linear.x + by) for by in (3e-5, 3e-4))
    term = Term(KNOWN[0], {"knock_impulse_n_s": 0.0}, (1,))
    assert predicts_no_better(linear, far_worse)
    assert not predicts_no_better(linear, replace(worse, terms=(term,)))
    assert predicts_no_better(linear, replace(far_worse, terms=(term,)))


@pytest.mark.long
def test_intervals_of_the_impulse_cover_as_often_as_they_say() -> None:
    rng, covered, tried = np.random.default_rng(9), 0, 12
    for seed in range(tried):
        when, size = rng.uniform(0.5, 2.8), rng.uniform(0.01, 0.05)
        low, _, high = impulse_of([driven([(when, 1, size)], 100 + seed)], rig())
        covered += low < size < high
    assert covered >= tried - 2


def test_nothing_knocked_where_nothing_did() -> None:
    answer = diagnose_recordings([driven([], 4)], rig(), KNOWN, learn=False).answer
    assert answer.verdict == "consistent"
    limit = next(u for u in answer.upper_limits if u.id == "knock")
    assert limit.parameter == "knock_impulse_n_s"
    assert 0 < limit.value < 0.01


@pytest.mark.parametrize("channel", [1, 2])
def test_one_wrong_sample_is_no_knock(channel: int) -> None:
    clean = driven([], 9)
    wrong = clean.data.copy()
    wrong[channel, 1301] += 12 * NOISE * wrong[channel].std()
    knocked = driven([(1301 / RATE, channel - 1, 0.002)], 9)
    scores = []
    for recording in (replace(clean, data=wrong), knocked):
        problem = problem_of(rig(), [prepare(recording, rig())])
        scores.append(second_impact_score(linear_fit(problem), KNOWN[0]))
    assert scores[0].gain == 0
    assert scores[0].p_value > 0.01
    assert scores[1].gain > 25
    assert scores[1].p_value < 1e-4


def test_an_impulse_beside_held_inputs_acts_in_one_substep() -> None:
    rows = np.arange(6.0).reshape(1, 2, 3)
    given = with_impulse(Given(rows, rows, 0 * rows, 4), 5.25, 2.0)
    assert given.held == 1
    assert np.array_equal(given.start[0, :2], np.repeat(rows[0], 4, axis=1))
    begin, end = given.start[0, 2], given.end[0, 2]
    assert np.array_equal(np.flatnonzero(begin + end), [5])
    assert (begin[5] + end[5]) / 2 == pytest.approx(2.0)  # of a straight line in one substep
    assert (begin[5] + 2 * end[5]) / 6 == pytest.approx(0.25 * 2.0)  # its first moment: when it acts


def test_a_knock_acts_on_driven_rigs_and_a_second_impact_in_decays() -> None:
    knock, again = listed("knock"), listed("double_hit")
    assert isinstance(knock, SecondImpact)
    free = parse_rig(
        "bodies: {mass: 1}\nsprings: [{between: [mass, ground], stiffness: unknown, damping: unknown}]\n"
        "sensors: [{channel: a, of: mass, shows: velocity}]\n"
    )
    assert [len(m.places(r.arrangement)) for r in (rig(), free) for m in (knock, again)] == [1, 0, 0, 1]
    said = said_of([Struck(0, 1.25, 0.02, 1e-4)], knock, "b", "N s")
    assert said == " It struck 'b' after 1.25 s in recording 1 (0.02 N s)."
    assert together([]) == (0.0, 0.0)
