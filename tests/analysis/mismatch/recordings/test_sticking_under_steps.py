"""Dry friction that holds a body between the steps of its drive."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from mesotap.configuration.rig_files import parse_rig
from tests.analysis.mismatch.recordings.described_rigs import recorded
from tests.analysis.terms import listed
from tests.sim_backend.test_sticking import FRICTION, HELD, LEVELS, MASS, RATE, closed_form

RIG = parse_rig(f"""
bodies: {{mass: {MASS}}}
joints: [{{between: [mass, ground], stiffness: unknown, damping: unknown}}]
inputs: [{{channel: 0, force_on: mass}}]
sensors: [{{channel: 1, of: mass, shows: displacement}}]
recording: {{hold: zero}}
""")


@pytest.mark.long
def test_friction_that_holds_a_body_most_of_the_time_has_its_size_and_leaves_nothing() -> None:
    x, _ = closed_form().T
    known = [listed(name) for name in ("guide_friction", "quadratic_damping", "contact_creep")]
    columns = [np.repeat(LEVELS, HELD), x]
    answer = diagnose_recordings([recorded(columns, RATE, 1e-3)], RIG, known, learn=False).answer
    assert [m.id for m in answer.mechanisms] == ["guide_friction"]
    force = answer.mechanisms[0].parameters["friction_force_n"]
    assert force.low < FRICTION < force.high
    assert force.high - force.low < 0.02
    assert answer.remainder.p_value > 0.01
