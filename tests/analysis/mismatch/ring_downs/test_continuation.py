"""Strong effects: from the late part of the segments to the whole."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.ring_downs.continuation import continued, earlier
from analysis.mismatch.ring_downs.fit import RingDowns, fit
from tests.analysis.practice import needs_data, practice, truth
from tests.analysis.ring_downs import LOADS_N, problem_of, session_of, two_mass, with_law
from tests.analysis.terms import at_work


def few_impacts(case: str) -> RingDowns:
    return problem_of(practice(case)).only((0, 1, 8, 9, 16, 24, 32, 40))


@pytest.mark.slow
@pytest.mark.data
@needs_data
def test_surfaces_that_part_by_ten_times_the_preload_are_fitted_to_the_noise() -> None:
    problem = few_impacts("case-022")
    true = truth("case-022")["kc"]
    linear = fit(problem)
    found = continued(problem, (at_work("contact_loss", {}),), linear)
    assert found is not None
    before, after = linear.reduced_chi_squared, found.reduced_chi_squared
    assert before > 50
    assert after < 1.02
    assert found.constants.load[:, 0] == pytest.approx(true, rel=2e-3)


@pytest.mark.data
@needs_data
def test_running_backward_leads_to_where_the_segment_began() -> None:
    problem = few_impacts("case-006")
    whole = fit(problem, (at_work("contact_loss", {}),), begin=fit(problem))
    skipped = 40
    later = fit(problem.cropped(skipped), whole.terms, begin=whole)
    for i, began in enumerate(whole.amplitudes):
        assert np.abs(earlier(later, i, skipped) - began).max() < 0.02 * np.abs(began).max()


@pytest.mark.slow
def test_surfaces_that_part_are_fitted_without_any_recording() -> None:
    session = session_of(with_law("contact_loss"), noise=0.02, ratios=(1.2, 1.5, 1.8))
    problem = problem_of(session)
    linear = fit(problem)
    found = continued(problem, (at_work("contact_loss", {}),), linear)
    assert found is not None
    before, after = linear.reduced_chi_squared, found.reduced_chi_squared
    assert before > 500
    assert after < 1.1
    true = [two_mass(load).kc for load in LOADS_N]
    assert found.constants.load[:, 0] == pytest.approx(true, rel=1e-3)
