"""Constants that no channel determines: a fit's split between them is a choice, and no interval is stated."""

from __future__ import annotations

import math

import numpy as np

from analysis.mismatch.diagnosis import diagnose_recordings
from mesotap.configuration.rig_files import parse_rig
from tests.analysis.mismatch.recordings.described_rigs import RATE, SAMPLES, motion, recorded
from tests.analysis.terms import listed

RIG = """
bodies: {mass: 1.0}
springs: [{name: spring, between: [mass, ground], stiffness: unknown, damping: unknown}]
slides: [{name: slide, between: [mass, ground], damping: %s}]
inputs: [{channel: 0, force_on: mass, offset: 0}]
sensors: [{channel: 1, of: mass, shows: velocity}]
"""


def constants(damping: str) -> dict[str, tuple[float, float, float]]:
    t = np.arange(SAMPLES) / RATE
    u = np.sum([np.sin(2 * np.pi * f * t + f * f) for f in np.arange(0.3, 6.0, 0.35)], axis=0)
    y = motion(lambda s, x, v: s - 400.0 * x - 3.0 * v, [0.0, 0.0], SAMPLES, RATE, u)
    rig = parse_rig(RIG % damping)
    found = diagnose_recordings([recorded([u, y[1]], RATE, 0.01)], rig, [listed("quadratic_damping")], learn=False)
    assert found.answer.fitted is not None
    return {name: (i.value, i.low, i.high) for name, i in found.answer.fitted.constants.items()}


def test_two_dampers_side_by_side_have_no_intervals_and_one_of_them_declared_tells_the_other() -> None:
    both = constants("unknown")
    assert abs(both["damping of spring"][0] + both["damping of slide"][0] - 3.0) < 0.05
    for name in ("damping of spring", "damping of slide"):
        assert math.isinf(both[name][1])
        assert math.isinf(both[name][2])
    value, low, high = both["stiffness of spring"]
    assert low < value < high
    assert low < 400.0 < high
    value, low, high = constants("1.0")["damping of spring"]
    assert low < 2.0 < high
    assert high - low < 0.1
