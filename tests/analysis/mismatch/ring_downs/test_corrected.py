"""The contact in the limit of no motion."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.ring_downs.corrected import contact_at_rest
from analysis.mismatch.ring_downs.fit import fit
from tests.analysis.ring_downs import problem_of, session_of, two_mass, with_law


def test_the_contact_at_rest_is_that_of_eq_9_with_intervals_that_hold_it() -> None:
    for found in contact_at_rest(fit(problem_of(session_of(with_law(), noise=0.01)))):
        true = two_mass(found.load_n)
        for estimate, value in (
            (found.stiffness, true.kc),
            (found.damping, true.cc),
            (found.damping_ratio, true.modes()[3]),
        ):
            assert abs(estimate.value - value) < 3.5 * estimate.standard_error
            assert estimate.standard_error < 0.02 * value


def test_where_impacts_have_a_contact_of_their_own_a_load_has_their_mean() -> None:
    problem = problem_of(session_of(with_law(), noise=0.01)).per_impact_constants()
    found = fit(problem)
    loads = contact_at_rest(found)
    assert [c.load_n for c in loads] == sorted(set(problem.experiment.loads_n))
    for contact in loads:
        own = [
            found.constants.at(group)["kc"]
            for group, load in enumerate(problem.experiment.loads_n)
            if load == contact.load_n
        ]
        assert len(own) > 1
        assert contact.stiffness.value == pytest.approx(np.mean(own), rel=1e-12)
        assert abs(contact.stiffness.value - two_mass(contact.load_n).kc) < 3.5 * contact.stiffness.standard_error
        # the scatter between impacts counts
        assert contact.stiffness.standard_error >= np.std(own, ddof=1) / np.sqrt(len(own))
