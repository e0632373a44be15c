"""A second impact wherever it falls: in a stretch that would be held out, late, after silence, thinned out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.recordings.recorded import BLOCKS, CHOOSE, FIT, HELD, PARTS, UNUSED, prepare
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from tests.analysis.terms import listed

RATE, SAMPLES = 300.0, 960
OMEGA, DECAY = 2 * np.pi * 14.7, 1.4
NOISE = 1e-3  # rms, over the largest deflection
RIG = parse_rig(
    "bodies: {mass: 1}\ncontacts: [{between: [mass, ground], stiffness: unknown, damping: unknown}]\n"
    "sensors: [{channel: a, of: mass, shows: velocity}]\n"
)


def ringing(s: np.ndarray, decay: float = DECAY, omega: float = OMEGA) -> np.ndarray:
    """Return the speed of a body at times from when an impulse of a unit struck it."""
    after = np.maximum(s, 0.0)
    return (s >= 0) * np.exp(-decay * after) * (np.cos(omega * after) - decay / omega * np.sin(omega * after))


def struck_twice(block: int, share: float, seed: int = 1) -> Recording:
    """Return a decay with a second impact in the middle of a block."""
    t, when = np.arange(SAMPLES) / RATE, (block + 0.47) * SAMPLES / BLOCKS / RATE

    y = ringing(t) + share * ringing(t - when)
    y += 1e-3 * np.random.default_rng([seed, block]).standard_normal(SAMPLES)
    return Recording(y[None], RATE, ("a",), "", f"struck in block {block}")


@pytest.mark.parametrize("block", [3, 5, 7])  # held out, choosing, held out
def test_a_second_impact_is_named_wherever_it_fell(block: int) -> None:
    recordings = [struck_twice(block, 0.03, seed) for seed in (1, 2)]
    known = [listed("double_hit"), listed("tube_spring_cubic"), listed("contact_creep")]
    answer = diagnose_recordings(recordings, RIG, known, learn=False).answer
    assert [m.id for m in answer.mechanisms] == ["double_hit"]
    share = answer.mechanisms[0].parameters["second_impulse_fraction"]
    assert share.low < 0.03 < share.high
    assert share.high - share.low < 0.01
    assert answer.remainder.p_value > 0.01


@pytest.mark.parametrize("block", range(8))
def test_divided_anew_a_sample_is_fitted_and_as_much_is_held_out(block: int) -> None:
    recorded = prepare(struck_twice(block, 0.0), RIG)
    sample = int(np.flatnonzero(recorded.block == block)[0])
    moved = recorded.fitted_at(sample)
    assert moved.part[sample] == FIT
    assert np.all(moved.part[moved.block == 0] == recorded.part[moved.block == 0])  # where it begins is fitted
    assert (moved is recorded) == (PARTS[block % PARTS.size] == FIT)
    for part in (FIT, CHOOSE, HELD, UNUSED):
        assert abs(np.count_nonzero(moved.part == part) - np.count_nonzero(recorded.part == part)) < SAMPLES / BLOCKS


@pytest.mark.parametrize("silent", [0, 5, 12, 40])
def test_a_decay_is_counted_from_where_silence_ends(silent: int) -> None:
    decay = struck_twice(3, 0.0)
    noise = 1e-3 * np.random.default_rng(7).standard_normal(silent)
    late = Recording(np.append(noise, decay.data[0])[None], RATE, ("a",), "", "silent at first")
    recorded = prepare(late, RIG)
    assert recorded.rang_s == pytest.approx(prepare(decay, RIG).rang_s, abs=2 / RATE)


@pytest.mark.parametrize(("rate", "when"), [(2570.0, 2.9283), (6000.0, 2.4)])
def test_impacts_are_exact_in_a_recording_that_is_thinned_out(rate: float, when: float) -> None:
    """The filter before thinning out spreads the jump of the speed at either impact over some samples."""
    t, first = np.arange(round(3.4 * rate)) / rate, 0.0507

    y = ringing(t - first) + 0.05 * ringing(t - when)
    y += NOISE * np.random.default_rng(round(rate)).standard_normal(t.size)
    recording = Recording(y[None], rate, ("a",), "", "struck twice")
    assert prepare(recording, RIG).every > 1
    answer = diagnose_recordings([recording], RIG, [listed("double_hit"), listed("contact_creep")], learn=False).answer
    assert [m.id for m in answer.mechanisms] == ["double_hit"]
    share = answer.mechanisms[0].parameters["second_impulse_fraction"]
    assert share.low < 0.05 < share.high
    assert share.high - share.low < 0.004
    assert answer.remainder.p_value > 0.01
    assert answer.fit.noise_rms < 1.15 * NOISE / np.sqrt(prepare(recording, RIG).every)


def test_a_fit_begins_before_the_sample_that_shows_an_impact_first() -> None:
    """At that sample the speed is not yet the one after it: a fit that begins there cannot move."""
    rate, first, when = 4000.0, 0.13337, 0.13337 + 0.0813
    decay, omega, t = 1.00531, math.sqrt(15791.4 - 1.00531**2), np.arange(8000) / 4000.0

    y = ringing(t - first, decay, omega) + 0.05 * ringing(t - when, decay, omega)
    y += 1e-3 * y.std() * np.random.default_rng(3).standard_normal(t.size)
    recording = Recording(y[None], rate, ("a",), "", "struck early")
    known = [listed("double_hit"), listed("contact_creep")]
    answer = diagnose_recordings([recording], RIG, known, learn=False).answer
    assert [m.id for m in answer.mechanisms] == ["double_hit"]
    share = answer.mechanisms[0].parameters["second_impulse_fraction"]
    assert share.low < 0.05 < share.high
    assert share.high - share.low < 1e-3
