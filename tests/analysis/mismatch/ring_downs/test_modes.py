"""When a tap struck, from the phase of the lowest mode."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.ring_downs.experiment import Segment
from analysis.mismatch.ring_downs.linear import LinearRig
from analysis.mismatch.ring_downs.modes import Sensitivity

DRIVE = 0.7 - 0.2j


def mode(pole: complex, drive: complex) -> Sensitivity:
    """A rig of one mode."""
    one = np.ones((1, 1), np.complex128)
    rig = LinearRig(np.array([pole]), one, one, np.array([drive]), one, one, one, np.ones((1, 1)), np.array([2.0]))
    none = np.zeros((0, 1), np.complex128)
    return Sensitivity(rig, none, none[:, None], none)


def segment() -> Segment:
    return Segment("", np.zeros((1, 1)), np.zeros((1, 1)), 0.9e-3, 0, 0.1, 0)


@pytest.mark.parametrize("struck_s", [-0.2e-3, 0.05e-3, 0.1e-3, 0.45e-3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_phase_of_the_lowest_mode_tells_when_the_tap_struck(struck_s: float, sign: float) -> None:
    slow = -8.0 + 2j * np.pi * 330.0
    amplitude = np.array([sign * 3.1 * DRIVE * np.exp(slow * (segment().start_s - struck_s))])
    found = mode(slow, DRIVE).since_tap(amplitude, segment())
    assert segment().start_s - found == pytest.approx(struck_s, abs=1e-12)


def test_a_tap_is_not_looked_for_far_from_the_trigger() -> None:
    slow = 2j * np.pi * 330.0
    amplitude = np.array([np.exp(slow * (segment().start_s - 0.8e-3))])
    assert segment().start_s - mode(slow, 1.0).since_tap(amplitude, segment()) == pytest.approx(0.5e-3)
