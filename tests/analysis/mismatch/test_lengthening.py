"""Strong effects: from the late part of the records to the whole."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from analysis.mismatch import diagnosis
from analysis.mismatch.fit import fit
from analysis.mismatch.lengthening import earlier, lengthened, misfit
from analysis.mismatch.problem import Problem, Term
from daq.session_file import read_session
from sim_backend.mechanisms.mechanism import mechanisms
from tests.analysis.ring_downs import LOADS_N, session_of, two_mass, with_law

DATA = Path(os.environ.get("MESOTAP_DATA", Path(__file__).parents[4] / "shared" / "data")) / "concealed-practice"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no practice sessions at {DATA}")


def few_impacts(case: str) -> Problem:
    return diagnosis.tester_problem(read_session(DATA / f"{case}.h5")).only((0, 1, 8, 9, 16, 24, 32, 40))


@pytest.mark.data
@needs_data
def test_surfaces_that_part_by_ten_times_the_preload_are_fitted_to_the_noise() -> None:
    problem = few_impacts("case-022")
    true = json.loads((DATA / "truth.json").read_text())["case-022"]["kc"]
    linear = fit(problem)
    found = lengthened(problem, (Term(mechanisms()["contact_loss"], {}),), linear)
    assert found is not None
    before, after = misfit(linear), misfit(found)
    assert before > 50
    assert after < 1.02
    assert found.constants.load[:, 0] == pytest.approx(true, rel=2e-3)


@pytest.mark.data
@needs_data
def test_running_backward_leads_to_where_the_record_began() -> None:
    problem = few_impacts("case-006")
    whole = fit(problem, (Term(mechanisms()["contact_loss"], {}),), begin=fit(problem))
    skipped = 40
    later = fit(problem.later(skipped), whole.terms, begin=whole)
    for i, began in enumerate(whole.amplitudes):
        assert np.abs(earlier(later, i, skipped) - began).max() < 0.02 * np.abs(began).max()


def test_surfaces_that_part_are_fitted_without_any_recording() -> None:
    session = session_of(with_law("linear", can_part=True), noise=0.02, ratios=(1.2, 1.5, 1.8))
    problem = diagnosis.tester_problem(session)
    linear = fit(problem)
    found = lengthened(problem, (Term(mechanisms()["contact_loss"], {}),), linear)
    assert found is not None
    before, after = misfit(linear), misfit(found)
    assert before > 500
    assert after < 1.1
    true = [two_mass(load).kc for load in LOADS_N]
    assert found.constants.load[:, 0] == pytest.approx(true, rel=1e-3)
