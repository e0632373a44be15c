"""Strong effects: from parts of the segments to the whole."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.ring_downs.continuation import (
    FIRST_S,
    beginnings,
    continued,
    declared_scales,
    each_alone,
    earlier,
    lengthened,
    linear_at_first,
)
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


@pytest.mark.long
@pytest.mark.parametrize(
    ("law", "other"),
    [("rough_surface_stiffness", "hertz_stiffness"), ("hertz_stiffness", "rough_surface_stiffness")],
)
def test_a_strong_law_is_fitted_from_the_beginnings_of_the_segments_on(law: str, other: str) -> None:
    ratios = (0.5, 0.7, 0.9) if law == "rough_surface_stiffness" else (0.5, 0.7, 0.95)
    problem = problem_of(session_of(with_law(law), noise=5e-4, ratios=ratios)).only((*range(7), 8))
    linear = fit(problem)
    early = linear_at_first(problem, linear)
    found = lengthened(problem, (at_work(law, {}),), early)
    assert found.reduced_chi_squared < 1.5
    true = [two_mass(load).kc for load in LOADS_N]
    assert found.constants.load[:, 0] == pytest.approx(true, rel=1e-3)
    assert found.penalty < 16  # masses are as declared, within their uncertainty
    assert lengthened(problem, (at_work(other, {}),), early).reduced_chi_squared > 1000


@pytest.mark.slow
def test_taps_that_part_the_surfaces_are_fitted_beside_taps_that_do_not() -> None:
    whole = problem_of(session_of(with_law("contact_loss"), noise=5e-4, ratios=(0.6, 0.9, 1.3)))
    linear = fit(whole)
    found = lengthened(whole, (at_work("contact_loss", {}),), linear_at_first(whole, linear))
    assert linear.reduced_chi_squared > 100
    assert found.reduced_chi_squared < 1.1
    true = [two_mass(load).kc for load in LOADS_N]
    assert found.constants.load[:, 0] == pytest.approx(true, rel=1e-3)
    assert found.penalty < 16


@pytest.mark.slow
def test_amplitudes_of_a_tap_are_found_from_its_first_periods() -> None:
    whole = problem_of(session_of(with_law("contact_loss"), noise=5e-3, ratios=(0.6, 1.3)))
    linear = fit(whole)
    short = beginnings(whole, FIRST_S)
    laws = (at_work("contact_loss", {}),)
    fitted = lengthened(whole, laws, linear_at_first(whole, linear))
    alone = each_alone(short, laws, declared_scales(fitted))
    assert len(alone) == len(whole.experiment.segments)
    for found, true in zip(alone, fitted.amplitudes, strict=True):
        assert np.abs(found - true).max() < 0.01 * np.abs(true).max()
