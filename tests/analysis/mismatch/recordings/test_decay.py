"""What is said of frequency and damping along a decay."""

from __future__ import annotations

import pytest

from analysis.mismatch.answer import AtAmplitude
from analysis.mismatch.recordings.decay import along_words


@pytest.mark.parametrize(("unit", "to"), [("m/s2", "to 1.24 m/s2 the"), ("", "to 1.24 the")])
def test_a_decay_is_told_in_the_channel_s_unit_if_it_has_one(unit: str, to: str) -> None:
    decay = [AtAmplitude(0.1, 41.3, 178.2, 0.0148), AtAmplitude(0.5, 1.24, 180.1, 0.0173)]
    assert to in along_words(decay, unit)


def test_nothing_is_said_of_no_decay() -> None:
    assert along_words([], "m") == ""
