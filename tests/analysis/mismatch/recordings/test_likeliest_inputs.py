"""Inputs with noise: what is taken off them, and what is still found in rigs that are driven in a band."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.recordings.blocks import of_least_noise, over_noise
from analysis.mismatch.recordings.input_noise import drawn, likeliest, rms_of_inputs, with_likeliest_inputs
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.recorded import Recorded, prepare
from analysis.mismatch.selection import screened_baseline
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.described_rigs import noise_input

RATE, SAMPLES, RISE = 2000.0, 4000, 40
MASSES, HZ, RATIO = np.array([0.9, 0.6, 0.35]), np.array([95.0, 170.0, 260.0]), 0.018
ACROSS = np.array([[1.0, 0, 0], [-1, 1, 0], [0, -1, 1]])
RIG = parse_rig("""
bodies: {base: 0.9, middle: 0.6, top: 0.35}
joints:
- {name: foot, between: [base, ground]}
- {name: waist, between: [middle, base]}
- {name: neck, between: [top, middle]}
inputs: [{channel: force, force_on: top, offset: 0}]
sensors:
- {channel: a, of: base, shows: acceleration}
- {channel: b, of: middle, shows: acceleration}
- {channel: c, of: top, shows: acceleration}
recording: {hold: band-limited}
""")


def force_in_a_band(seed: int, low_hz: float, size: int = 2 * SAMPLES) -> Real:
    """Return a force up to 0.2 of the rate that begins at rest and is over in the middle."""
    t = np.arange(size)
    inside = np.clip(np.minimum(t, SAMPLES - t) / RISE, 0.0, 1.0)
    return noise_input(size, RATE, low_hz, 400, seed) * np.sin(np.pi / 2 * inside) ** 2


def whole_stiffness() -> Real:
    """Return the stiffness (3, 3) of bodies in a row, before it is made so that the first mode is where it is asked."""
    return np.asarray(ACROSS.T @ np.diag(MASSES * (2 * np.pi * HZ) ** 2) @ ACROSS, np.float64)


def chain(first_hz: float, seed: int, share: float, low_hz: float = 20.0, sensors_share: float = 3e-3) -> Recording:
    """Return a recording of three bodies in a row, solved line by line; of the force a share of its rms is noise."""
    damping = ACROSS.T @ np.diag(2 * RATIO * MASSES * 2 * np.pi * HZ) @ ACROSS
    whole = whole_stiffness()
    slowest = np.sqrt(np.linalg.eigvals(whole / MASSES[:, None]).real.min())
    faster = 2 * np.pi * first_hz / slowest
    size = 4 * SAMPLES  # of which the second half is at rest again: periodic
    u = np.concatenate([force_in_a_band(seed, low_hz), np.zeros(size - 2 * SAMPLES)])
    s = 2j * np.pi * np.fft.rfftfreq(size, 1 / RATE)[:, None, None]
    answer = np.linalg.inv(whole * faster**2 + s * damping * faster + s**2 * np.diag(MASSES))[:, :, 2] * s[:, :, 0] ** 2
    seen = np.fft.irfft(np.fft.rfft(u)[:, None] * answer, size, axis=0)[: SAMPLES - 2 * RISE].T
    random, force = np.random.default_rng([seed, 1]), u[: SAMPLES - 2 * RISE]
    rows = np.stack([force + share * force.std() * random.normal(size=force.size), *seen])
    rows[1:] += sensors_share * np.std(rows[1:], axis=1, keepdims=True) * random.normal(size=rows[1:].shape)
    return Recording(rows, RATE, ("force", "a", "b", "c"), "", "chain")


@pytest.mark.parametrize("share", [0.005, 0.05])
def test_what_is_taken_off_an_input_is_its_noise_where_it_has_nothing_else(share: float) -> None:
    force = noise_input(SAMPLES, RATE, 20, 400, seed=4)
    measured = force + share * np.random.default_rng(9).normal(size=SAMPLES)
    inner = slice(200, -200)
    left = np.std((likeliest(measured, share) - force)[inner]) / share
    assert left == pytest.approx(np.sqrt(380 / 1000), rel=0.08)  # the band's own noise stays


def test_edges_stay_as_they_were_measured_and_taps_as_they_were() -> None:
    t, noise = np.arange(SAMPLES), 0.02 * np.random.default_rng(2).normal(size=SAMPLES)
    edges = np.where((t // 500) % 2, 1.0, -1.0) + noise
    assert likeliest(edges, 0.02) is edges
    taps = 50.0 * np.isin(t % 900, (100, 101, 102))
    assert np.abs(likeliest(taps + noise, 0.02) - taps).max() < 5 * 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("first_hz", "seed", "share"), [(182.0, 501, 0.005), (103.0, 708, 0.05)])
def test_a_sound_rig_driven_in_a_band_is_found_sound(first_hz: float, seed: int, share: float) -> None:
    """Beyond the band the noise of the force seems to drive a rig that does not answer: relaxation, p below 1e-7."""
    problem = problem_of(RIG, [prepare(chain(first_hz, seed, share), RIG)])
    judge = BlockJudge.of(problem, variants(catalogue()))
    linear = screened_baseline(judge)
    assert linear.screening.p_value > 1e-3
    # noise of the force makes up to five times as much of the errors as that of the sensors
    assert over_noise(linear.current) == pytest.approx(1, abs=0.2)


def ready(recording: Recording, noise: float | None = None) -> Recorded:
    """Return a recording as the linear rig's fit to it leaves it, with the noise of its force declared or not."""
    rig = replace(RIG, drives=tuple(replace(d, noise=noise) for d in RIG.drives))
    (found,) = with_likeliest_inputs(linear_fit(problem_of(rig, [prepare(recording, rig)])))
    return found


def test_draws_are_as_large_as_what_the_input_is_off_by() -> None:
    share = 0.02
    clean, recorded = chain(120.0, 31, 0.0).data[0], ready(chain(120.0, 31, share))
    inner = slice(500, -500)
    normal = np.random.default_rng(1).normal(size=(20, *recorded.inputs.shape))
    made = drawn(recorded, np.array([share * clean.std()]), normal)[:, 0, inner]
    off = (clean - recorded.inputs[0])[inner]
    assert np.std(off) < 0.8 * share * clean.std()
    assert np.std(made) == pytest.approx(np.std(off), rel=0.1)


def test_what_the_rig_answers_is_no_noise() -> None:
    """A command that nothing measures has noise of its own, which drives the rig: taken off, it would be missed."""
    recording, random = chain(120.0, 31, 0.0), np.random.default_rng(5)
    driven = linear_fit(problem_of(RIG, [prepare(recording, RIG)]))
    white = 0.02 * np.std(recording.data[0]) * random.normal(size=recording.data.shape[1])
    more = driven.simulation.with_inputs(0, driven.problem.recordings[0].inputs + white)
    shown, _ = more.runs([(driven.x, driven.own[0])], 0)
    rows = np.concatenate([recording.data[:1] + white, shown[0]])
    rows[1:] += 3e-3 * np.std(rows[1:], axis=1, keepdims=True) * random.normal(size=shown[0].shape)
    recorded = ready(replace(recording, data=rows))
    assert recorded.measured is None
    np.testing.assert_array_equal(recorded.inputs[0], rows[0])


def test_inputs_that_are_said_to_have_no_noise_are_as_measured_again() -> None:
    recording = chain(120.0, 31, 0.02)
    recorded = ready(recording)
    assert recorded.measured is not None
    rig = replace(RIG, drives=tuple(replace(d, noise=0.0) for d in RIG.drives))
    (again,) = with_likeliest_inputs(linear_fit(problem_of(rig, [recorded])))
    np.testing.assert_array_equal(again.inputs[0], recording.data[0])
    assert ready(recording, noise=0.0).measured is None


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_constants_are_not_biased_by_noise_at_the_modes_where_the_force_has_nothing_else(share: float) -> None:
    """Driven above its first modes: that of 60 Hz rings in the measured force's noise alone."""
    recorded = ready(chain(60.0, 41, share, low_hz=110.0))
    fitted = linear_fit(problem_of(RIG, [recorded]))
    slowest = np.sqrt(np.linalg.eigvals(whole_stiffness() / MASSES[:, None]).real.min())
    true = MASSES * (2 * np.pi * HZ) ** 2 * (2 * np.pi * 60.0 / slowest) ** 2
    found = [fitted.values[f"stiffness of {name}"] for name in ("foot", "waist", "neck")]
    np.testing.assert_allclose(found, true, rtol=0.3 * share)


@pytest.mark.parametrize(("share", "found"), [(0.04, 0.04), (0.1, 0.0)])
def test_much_noise_is_not_counted_before_the_rig_was_seen_not_to_answer_it(share: float, found: float) -> None:
    recording = chain(120.0, 31, share)
    recorded = prepare(recording, RIG)
    level = np.std(recorded.inputs[0])
    assert rms_of_inputs(RIG, recorded)[0] / level == pytest.approx(found, abs=0.005)
    assert rms_of_inputs(RIG, ready(recording))[0] / level == pytest.approx(share, rel=0.1)


def test_noise_that_drives_is_none_of_the_input() -> None:
    recording = chain(120.0, 31, 0.0)
    recording.data[0] = np.random.default_rng(3).normal(size=recording.data.shape[1])
    assert rms_of_inputs(RIG, prepare(recording, RIG))[0] == 0.0


@pytest.mark.slow
def test_what_noise_of_the_force_makes_is_noise_and_a_sensor_beside_it_is_found_by_what_it_makes() -> None:
    """Noise of the force makes 15 times as large residuals as a gain of 1.5 % does, but the same in all channels.

    An attached part makes them a little smaller still, as it follows some of that noise.
    """
    recording = chain(182.0, 902, 0.03)
    recording.data[1] *= 0.985
    known = [m for m in variants(catalogue()) if m.id in ("channel_gain", "attached_mass")]
    judge = BlockJudge.of(problem_of(RIG, [prepare(recording, RIG)]), known)
    linear = screened_baseline(judge)
    assert linear.current.scatter > 2 * judge.problem.policy.unlike_noise
    assert linear.current.as_noise
    first, second = judge.candidates(linear)[:2]
    assert (first.mechanism.id, second.mechanism.id) == ("channel_gain", "attached_mass")
    assert first.fit is not None
    assert second.fit is not None
    assert first.fit.scatter > second.fit.scatter
    assert of_least_noise((first.fit, second.fit)) is first.fit
    recording.data[1] *= 0.6 / 0.985
    assert not BlockJudge.of(problem_of(RIG, [prepare(recording, RIG)]), known).baseline().as_noise
