"""The contact in the limit of no motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.intervals import NORMAL_95
from analysis.mismatch.ring_downs.continuation import scales_kept
from analysis.mismatch.ring_downs.corrected import augmented, contact_at_rest
from analysis.mismatch.ring_downs.fit import fit
from mesotap.configuration.declared import header_uncertainty
from tests.analysis.ring_downs import M1, M2, problem_of, session_of, two_mass, with_law
from tests.analysis.terms import at_work


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


MASS_ERROR = header_uncertainty(session_of(with_law()))["m1_kg"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("load", "masses", "far"),
    [(1.005, (0.0, 0.0), False), (0.992, (-0.9, -0.9), False), (1.04, (0.0, 0.0), True), (0.96, (-0.9, 0.9), True)],
)
def test_loads_and_masses_that_are_a_little_wrong_leave_the_contact_within_its_intervals(
    load: float, masses: tuple[float, float], far: bool
) -> None:
    session = session_of(with_law("hertz_stiffness"), noise=0.002, ratios=(0.6, 0.9))
    impacts = tuple(
        replace(i, **{name: load * getattr(i, name) for name in ("load_before_mn", "load_after_mn")})
        for i in session.impacts
    )
    m1, m2 = (m + off * MASS_ERROR for m, off in zip((M1, M2), masses, strict=True))
    problem = problem_of(replace(session, impacts=impacts, rig=replace(session.rig, m1_kg=m1, m2_kg=m2)))
    with np.errstate(all="ignore"):  # of a trial step
        found = augmented(fit(problem), [at_work("hertz_stiffness")])
    assert (scales_kept(found) is not None) == far
    for contact in contact_at_rest(found):
        true = two_mass(contact.load_n / load)
        for estimate, value in ((contact.stiffness, true.kc), (contact.damping, true.cc)):
            assert abs(estimate.value - value) < NORMAL_95 * estimate.standard_error
            assert estimate.standard_error < (0.02 if far else 1e-3) * value
