"""The stream of an hour in short: nothing is lost or altered between the endpoint and the trigger, nothing piles up."""

from __future__ import annotations

import tracemalloc

import pytest

from benchmarks.streaming import stream
from rig.settings import Wiring


@pytest.mark.parametrize("wiring", [Wiring(), Wiring(strain_gauge_input=None), Wiring(sample_rate_hz=100e3)])
def test_no_sample_is_lost_or_altered(wiring):
    costs, _ = stream(wiring, 20.0)
    assert costs.samples >= 20 * wiring.sample_rate_hz
    assert (costs.lost, costs.wrong) == (0, 0)


def test_waiting_for_a_tap_takes_no_more_memory_the_longer_it_lasts():
    stream(Wiring(), 1.0)
    tracemalloc.start()
    try:
        stream(Wiring(), 10.0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1e6  # the stream itself is 6 MB
