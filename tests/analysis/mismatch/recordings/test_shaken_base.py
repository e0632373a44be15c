"""A rig on a shaken base whose accelerometers are on the bodies: they show the base's acceleration too."""

from __future__ import annotations

import functools
import re
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.recordings.input_noise import with_likeliest_inputs
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.model import made_by_input_noise
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.recordings.start_check import frame_remark
from analysis.session import AnalysisError
from daq.exchange import Recording
from mesotap.configuration.config import ConfigError
from mesotap.configuration.rig_files import parse_rig
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.described_rigs import OMEGA, RATE, SAMPLES, motion, noise_input

RIG = """
bodies: {mass: 1}
springs: [{between: [mass, ground], damping: unknown}]
inputs: [{channel: base, base_acceleration: true}]
sensors: [{channel: body, of: mass, shows: acceleration, unit: m/s2}]
"""
ABSOLUTE = RIG.replace("unit: m/s2", "unit: m/s2, absolute: true")
DAMPING = 0.08 * OMEGA


@functools.cache
def shaken() -> Recording:
    """Return the recording of a mass on a spring, its base shaken, with an accelerometer on each."""
    u = noise_input(SAMPLES, RATE, 0.5, 40, seed=9)
    x, v = motion(lambda s, x, v: -s - OMEGA**2 * x - DAMPING * v, [0.0, 0.0], SAMPLES, RATE, u)
    absolute = -(OMEGA**2) * x - DAMPING * v
    absolute += 0.01 * absolute.std() * np.random.default_rng(2).normal(size=absolute.size)
    return Recording(np.array([u, absolute]), RATE, ("base", "body"), "", "simulated")


def test_the_acceleration_of_the_base_is_subtracted_from_absolute_channels() -> None:
    given, relative = (prepare(shaken(), parse_rig(rig)).outputs for rig in (RIG, ABSOLUTE))
    assert np.allclose(given - relative, shaken().data[0][-given.shape[1] :], rtol=1e-12)


def test_the_gain_of_a_shaken_base_may_be_unknown_where_sensors_show_motion_relative_to_it() -> None:
    """It had made the recording one of no numbers, which ended in a traceback."""
    recording = shaken()
    base, absolute = recording.data
    rig = parse_rig(RIG.replace("base_acceleration: true", "base_acceleration: true, gain: unknown"))
    fitted = linear_fit(
        problem_of(rig, [prepare(replace(recording, data=np.array([base / 9.3, absolute - base])), rig)])
    )
    assert fitted.values["gain of input 1"] == pytest.approx(9.3, rel=2e-3)
    assert fitted.values["stiffness of spring"] == pytest.approx(OMEGA**2, rel=2e-3)


def noisy(share: float) -> Recording:
    """Return what `shaken` does, the base measured with noise of this share of its rms, the body with none."""
    recording = shaken()
    base, absolute = recording.data
    absolute = absolute - 0.01 * absolute.std() * np.random.default_rng(2).normal(size=absolute.size)
    return replace(recording, data=np.array([base + share * np.random.default_rng(5).normal(size=base.size), absolute]))


def test_noise_of_the_base_is_in_absolute_channels_as_it_is_taken_off_them() -> None:
    rig = parse_rig(ABSOLUTE.replace("base_acceleration: true", "base_acceleration: true, noise: 0.03"))
    fitted = linear_fit(problem_of(rig, [prepare(noisy(0.03), rig)]))
    made = made_by_input_noise(fitted.simulation, fitted.x, fitted.own[0], 0)
    assert made is not None
    assert np.sqrt(np.mean(made**2)) == pytest.approx(np.sqrt(np.mean(fitted.off(0)[0] ** 2)), rel=0.1)


def test_what_the_base_likeliest_did_is_taken_off_absolute_channels() -> None:
    """Beyond 40 Hz the base does nothing: what is measured there is noise, and in the channel as it is taken off."""
    rig, clean = parse_rig(ABSOLUTE), prepare(noisy(0.0), parse_rig(ABSOLUTE)).outputs
    measured = prepare(noisy(0.1), rig)
    (likeliest,) = with_likeliest_inputs(linear_fit(problem_of(rig, [measured])))
    assert likeliest.measured is not None
    off = [np.std((r.outputs - clean)[:, 30:-30]) for r in (measured, likeliest)]
    assert off[0] == pytest.approx(0.1, rel=0.05)
    assert off[1] < 0.75 * off[0]


@pytest.mark.slow
def test_an_accelerometer_on_a_shaken_body_leaves_nothing_once_it_is_said_to_be_absolute() -> None:
    answer = diagnose_recordings([shaken()], parse_rig(ABSOLUTE), variants(catalogue())).answer
    assert answer.verdict == "consistent"
    assert answer.fitted is not None
    for name, true in (("stiffness of spring", OMEGA**2), ("damping of spring", DAMPING)):
        found = answer.fitted.constants[name]
        assert found.low < true < found.high


def test_a_channel_in_the_other_frame_is_told_before_anything_is_fitted() -> None:
    with pytest.raises(AnalysisError, match=re.escape("write 'absolute: true' in the sensors of body")):
        diagnose_recordings([shaken()], parse_rig(RIG), [])
    moved = Recording(shaken().data - [[0.0], [1.0]] * shaken().data[0], RATE, ("base", "body"), "", "simulated")
    assert "write 'absolute: false' in the sensors of body" in frame_remark(parse_rig(ABSOLUTE), [moved])
    assert not frame_remark(parse_rig(ABSOLUTE), [shaken()])


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (("shows: acceleration, unit: m/s2", "shows: velocity"), "only an acceleration can be absolute"),
        (("base_acceleration: true", "force_on: mass"), "no input is a base_acceleration"),
        (("base_acceleration: true", "base_acceleration: true, gain: unknown"), "have to be known"),
        (("of: mass", "of: {mass: 2}"), "name one body"),
    ],
)
def test_what_cannot_be_subtracted_is_refused(changed: tuple[str, str], said: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        parse_rig(ABSOLUTE.replace(*changed))
