"""A channel that lags, in a recording that ends in fast motion: its last samples have no neighbours on one side."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, HELD, ONE_SIDED, UNUSED, prepare
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, variants

RATE, SAMPLES, PIECES, AT_REST, RISE = 700.0, 3000, 40, 20, 60  # Hz; steps in a sample; samples at rest, and of rise
MASSES, STIFFNESS, DAMPING = np.diag([0.31, 0.44]), np.array([[9e4, -4e4], [-4e4, 4e4]]), 7e-5  # damping in s
RIG = parse_rig("""
bodies: {near: 0.31, far: 0.44}
springs:
- {name: foot, between: [near, ground], stiffness: unknown, damping: unknown}
- {name: link, between: [far, near], stiffness: unknown, damping: unknown}
inputs: [{channel: u, force_on: near}]
sensors:
- {channel: one, of: near, shows: acceleration, unit: m/s2}
- {channel: two, of: far, shows: acceleration, unit: m/s2}
recording: {hold: band-limited}
""")


def shaken(lag: int, seed: int) -> Recording:
    """Return a recording under a force up to 0.3 of the rate; its first channel lags by fortieths of a sample."""
    random = np.random.default_rng(seed)
    t = np.arange(SAMPLES * PIECES) / RATE / PIECES
    lines = np.arange(4.0, 0.3 * RATE, 1.0)
    force = sum(np.cos(2 * np.pi * f * t + p) for f, p in zip(lines, random.uniform(0, 6.3, lines.size), strict=True))
    force = force * np.sin(np.pi / 2 * np.clip((t * RATE - AT_REST) / RISE, 0, 1)) ** 2
    inverse = np.linalg.inv(MASSES)
    forced = inverse[:, :1]
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ STIFFNESS, -DAMPING * inverse @ STIFFNESS]])
    b = np.vstack([np.zeros((2, 1)), forced])
    seen = signal.lsim((a, b, a[2:], forced), force, t)[1].T  # linear between steps: off by 0.02 % of what is fastest
    late = np.concatenate([np.zeros(lag), seen[0]])
    rows = np.stack([force[::PIECES], late[::PIECES][:SAMPLES], seen[1, ::PIECES]])
    rows[1:] += 5e-3 * np.std(rows[1:], axis=1, keepdims=True) * random.normal(size=(2, SAMPLES))
    return Recording(rows, RATE, ("u", "one", "two"), "", "shaken")


def test_the_last_samples_are_compared_with_nothing() -> None:
    part = prepare(shaken(5, 1), RIG).part
    assert np.all(part[-ONE_SIDED:] == UNUSED)
    assert np.all(np.isin(part[:-ONE_SIDED], (FIT, CHOOSE, HELD)))


@pytest.mark.slow
def test_a_channel_that_lags_is_named_where_fast_motion_goes_on_to_the_end() -> None:
    answer = diagnose_recordings([shaken(5, 1)], RIG, variants(catalogue())).answer
    (named,) = answer.mechanisms
    assert (named.id, named.place) == ("channel_skew", "sensor: channel one")
    lag = named.parameters["delay_of_b_samples"]
    assert lag.low < 5 / PIECES < lag.high
    assert answer.remainder.p_value > 0.01
    assert not answer.set_aside
