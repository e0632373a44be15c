"""The contact in the limit of no motion."""

from __future__ import annotations

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
