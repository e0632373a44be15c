"""How recordings are made ready, and what of one cannot be used."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.recordings.noise import Whitening
from analysis.mismatch.recordings.recorded import RINGING, prepare, thinned
from analysis.session import AnalysisError
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
