"""How recordings are made ready, and what of one cannot be used."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.recordings.noise import Whitening
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.recordings.thinning import RINGING, thinned
from analysis.session import AnalysisError
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from tests.analysis.mismatch.recordings.described_rigs import JOINT, recorded


def test_a_recording_that_shows_nothing_is_refused() -> None:
    rig = parse_rig(JOINT)
    recording = recorded([np.ones(1000)], 100.0, 0.0)
    with pytest.raises(AnalysisError, match="constant"):
        prepare(recording, rig)


def test_a_channel_that_is_not_there_is_named() -> None:
    rig = parse_rig(JOINT.replace("channel: 0", "channel: strain"))
    with pytest.raises(AnalysisError, match="no channel strain"):
        prepare(recorded([np.sin(np.arange(1000))], 100.0, 0.0), rig)


@pytest.mark.parametrize("factor", [2, 3, 7])
def test_thinning_out_leaves_white_noise_white_and_slow_motion_as_it_was(factor: int) -> None:
    noise = np.random.default_rng(factor).standard_normal((1, 40_000 * factor))
    found = thinned(noise, factor)
    assert (
        np.abs(Whitening.of(found, np.ones(found.size, bool)).taps[0, 0, 1:]).max() < 0.02
    )  # 4 standard errors of 40 000 samples
    t = np.arange(4000 * factor)
    for frequency in (0.01, 0.1, 0.19):
        found = thinned(np.cos(2 * np.pi * frequency / factor * t)[None], factor)[0]
        wanted = np.cos(2 * np.pi * frequency * np.arange(found.size))
        assert np.abs(found - wanted)[RINGING:-RINGING].max() < 1e-5


BY_UNITS = """
bodies: {mass: 2}
springs: [{between: [mass, ground], stiffness: 800, damping: 4}]
inputs: [{channel: push, %s}]
sensors: [{channel: y, of: mass, shows: %s, unit: %s}]
"""


@pytest.mark.parametrize(
    ("units", "pushes", "shows", "unit", "said"),
    [
        (("N", "m/s2"), "force_on: mass", "displacement", "V", "channel y is in m/s2, a unit of acceleration"),
        (("N", "mm"), "force_on: mass", "acceleration", '""', "channel y is in mm, a unit of displacement"),
        (
            ("N", "mm"),
            "force_on: mass",
            "displacement",
            "m",
            "y is read in mm and the rig file says m;",
        ),
        (
            ("N", "m/s2"),
            "force_on: mass",
            "acceleration",
            "g",
            "read in m/s2, to which .* converted, and the rig file says g",
        ),
        (("m/s2", "mm"), "force_on: mass", "displacement", "mm", "channel push is in m/s2.* that it is a force"),
        (
            ("N", "mm"),
            "base_acceleration: true",
            "displacement",
            "mm",
            "push is in N.* acceleration of the base",
        ),
    ],
)
def test_units_that_contradict_the_rig_file_are_refused(
    units: tuple[str, str], pushes: str, shows: str, unit: str, said: str
) -> None:
    recording = Recording(np.random.default_rng(1).normal(size=(2, 4000)), 200.0, ("push", "y"), "", "a.csv", units)
    with pytest.raises(AnalysisError, match=f"a.csv: .*{said}"):
        prepare(recording, parse_rig(BY_UNITS % (pushes, shows, unit)))


@pytest.mark.parametrize(
    ("units", "shows", "unit"),
    [
        (("N", "mm"), "displacement", "mm"),
        (("N", "m/s2"), "acceleration", "m/s^2"),
        (("", ""), "displacement", "um"),
        (("V", "V"), "velocity", "mm/s"),  # a gain that the rig knows
        (("counts", "cts"), "acceleration", "counts"),
        ((), "velocity", "m/s"),
    ],
)
def test_units_that_agree_or_say_nothing_of_motion_are_taken(units: tuple[str, ...], shows: str, unit: str) -> None:
    recording = Recording(np.random.default_rng(1).normal(size=(2, 4000)), 200.0, ("push", "y"), "", "a.csv", units)
    prepared = prepare(recording, parse_rig(BY_UNITS % ("force_on: mass", shows, unit)))
    assert prepared.outputs.shape == (1, 4000)
