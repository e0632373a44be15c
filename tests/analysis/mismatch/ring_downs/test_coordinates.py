"""Which added bodies are admissible."""

from __future__ import annotations

import pytest

from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs.coordinates import MOST_RATIO, admissible
from sim_backend.mechanisms.kinds import AddedBody
from tests.analysis.terms import at_work, listed


@pytest.mark.parametrize("name", ["attached_mass", "frame_compliance", "rocking"])
def test_a_body_that_hardly_rings_is_not_admissible(name: str) -> None:
    mechanism = listed(name)
    assert isinstance(mechanism, AddedBody)
    assert mechanism.body is not None
    mass, stiffness, damping = mechanism.body
    values = {mass: 4.0, stiffness: 9.0, damping: 2 * MOST_RATIO * 6.0}
    assert not admissible(Term(mechanism, {}, (2,)), values)
    assert admissible(Term(mechanism, {}, (2,)), values | {damping: 0.9 * values[damping]})


def test_what_adds_no_body_is_admissible() -> None:
    assert admissible(at_work("micro_slip"), {})
