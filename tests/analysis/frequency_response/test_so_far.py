"""What a hammer shows while taps are made, on simulated taps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.frequency_response.cross_check import response_of
from analysis.frequency_response.so_far import HammerSoFar, hammer_so_far
from daq.records import Impact, RigDescription
from daq.settings import Trigger
from daq.trigger import record_impact
from rig.settings import Hammer, RigSettings, Wiring
from sim_backend.rig import SimulatedRig
from sim_backend.settings import BadTaps, SimBackendSettings

NONE_BAD = BadTaps(double=0, too_hard=0, too_weak=0, off_centre=0, clipped=0)
UNFILTERED = RigDescription(filter_family="")


@pytest.fixture(scope="module")
def impacts() -> list[Impact]:
    """Return four taps at 0.5 N."""
    settings = RigSettings(wiring=Wiring(hammer=Hammer(input=3)))
    rig = SimulatedRig(settings, SimBackendSettings(bad_taps=NONE_BAD, parameter_errors=False), seed=3)
    rig.stage.move_by(149.0)
    rig.stage.advance(10.0, 0.1, lambda: rig.true_load_mn() >= 500.0)
    found = []
    for number in range(4):
        r = record_impact(rig.accelerometers, rig.impactor, rig.clock, Trigger(), 500.0)
        place = (number, 0, 500.0, 500.0, 500.0, r.time, r.sample_rate_hz, r.pretrigger, r.acceleration)
        found.append(Impact(*place, accepted=True, force=r.force))
    return found


def test_what_is_said(impacts: list[Impact]) -> None:
    one, all_four = hammer_so_far(impacts[:1]).words, hammer_so_far(impacts).words
    assert "excites to 43" in one
    assert "coherence" not in one
    assert "4 taps: coherence 0.9" in all_four or "coherence 1.00" in all_four
    assert hammer_so_far([replace(i, force=None) for i in impacts]) == HammerSoFar()


def test_the_last_tap_beside_the_average(impacts: list[Impact]) -> None:
    found = hammer_so_far(impacts)
    averaged, last = found.averaged, found.last
    assert averaged is not None
    assert last is not None
    assert averaged.averages == 4
    alone = response_of(impacts[-1:], UNFILTERED, None).response
    for f in (200.0, 1500.0, 3000.0):
        at, there = np.argmin(abs(averaged.frequency_hz - f)), np.argmin(abs(alone.frequency_hz - f))
        assert abs(last[at]) == pytest.approx(abs(alone.h1[0, there]), rel=0.02)
    assert not np.allclose(last, averaged.h1[0], rtol=1e-4)


def test_a_tap_that_cannot_be_used_is_said_and_leaves_the_average(impacts: list[Impact]) -> None:
    dead = replace(impacts[3], force=np.zeros_like(impacts[3].force))
    found = hammer_so_far([*impacts[:3], dead])
    assert found.words.startswith("hammer: no hit can be used: ")
    assert found.last is None
    assert found.averaged is not None
    assert found.averaged.averages == 3
    assert hammer_so_far([dead]).averaged is None


def test_an_overload_is_said_where_the_reach_of_the_channel_is_known(impacts: list[Impact]) -> None:
    peak = float(np.abs(impacts[0].force).max())
    small = Hammer(input=3, largest_force_n=0.9 * peak)
    assert "overloaded" in hammer_so_far(impacts[:1], UNFILTERED, small).words
    assert "overloaded" not in hammer_so_far(impacts[:1]).words
