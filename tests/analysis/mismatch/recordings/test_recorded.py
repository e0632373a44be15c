"""What of a recording cannot be used."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.recordings.recorded import prepare
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
