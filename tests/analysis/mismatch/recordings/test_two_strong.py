"""Two strong effects in two decays, made by SciPy's own integrator: neither is accepted alone."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from daq.exchange import Recording
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrays import Real
from sim_backend.mechanisms.catalogue import catalogue
from tests.analysis.mismatch.recordings.described_rigs import motion, recorded

RATE, SAMPLES = 256.0, 1800
MASS, STIFFNESS, DAMPING, CUBED = 2.0, 9000.0, 3.0, 3.5e7
PART, PART_HZ, PART_RATIO = 0.2, 13.0, 0.02
RIG = f"""
bodies: {{sled: {MASS}}}
springs: [{{name: leaf, between: [sled, ground], stiffness: unknown, damping: unknown}}]
sensors: [{{channel: 0, of: sled, shows: velocity, unit: m/s}}]
"""


def struck(speed: float, seed: int) -> Recording:
    omega = 2 * np.pi * PART_HZ

    def acting(s: float, x: Real, v: Real) -> Real:
        pull = PART * (omega**2 * (x[1] - x[0]) + 2 * PART_RATIO * omega * (v[1] - v[0]))
        return np.array([(pull - STIFFNESS * x[0] - DAMPING * v[0] - CUBED * x[0] ** 3) / MASS, -pull / PART])

    states = motion(acting, [0.0, 0.0, speed, 0.0], SAMPLES, RATE)
    return recorded([states[2]], RATE, 0.004, seed=seed)


@pytest.mark.slow
def test_a_part_and_a_cubic_spring_that_are_both_strong_are_named_together() -> None:
    known = [catalogue()[name][-1] for name in ("attached_mass", "tube_spring_cubic", "frame_compliance")]
    found = diagnose_recordings([struck(0.6, 1), struck(0.11, 2)], parse_rig(RIG), known, learn=False).answer
    cubic, part = sorted(found.mechanisms, key=lambda m: m.id != "tube_spring_cubic")
    assert (cubic.id, part.id) == ("tube_spring_cubic", "attached_mass")
    assert cubic.parameters["cubic_stiffness_n_per_m3"].value == pytest.approx(CUBED, rel=0.005)
    assert part.parameters["mount_frequency_hz"].value == pytest.approx(PART_HZ, rel=1e-3)
