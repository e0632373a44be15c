"""At which channels of a rig one that is wrong may be."""

from types import SimpleNamespace
from typing import cast

import pytest

from sim_backend.arrangement import Arrangement
from sim_backend.mechanisms.places import channels_that_differ


def rig(bodies: list[int], inputs: int) -> Arrangement:
    sensors = [SimpleNamespace(row=((body, 1.0),), quantity="acceleration") for body in bodies]
    return cast("Arrangement", SimpleNamespace(sensors=sensors, inputs=inputs))


@pytest.mark.parametrize(
    ("bodies", "inputs", "places"),
    [
        ([0], 1, []),
        ([0, 0], 0, [(1,)]),
        ([0, 0], 1, [(0,), (1,)]),
        ([0, 1], 0, [(0,), (1,)]),
        ([0, 0, 1], 0, [(0,), (1,), (2,)]),
    ],
)
def test_any_channel_but_the_first_of_a_pair_that_nothing_tells_apart(
    bodies: list[int], inputs: int, places: list[tuple[int, ...]]
) -> None:
    assert channels_that_differ(rig(bodies, inputs)) == places
