"""The score test of a second impact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.ring_downs.fit import fit
from analysis.mismatch.ring_downs.second_impact import second_impact_score
from sim_backend.mechanisms.kinds import SecondImpact
from tests.analysis.ring_downs import problem_of, session_of, with_law
from tests.analysis.terms import at_work


def test_what_the_rig_can_do_by_itself_counts_for_no_second_impact() -> None:
    # beside a strong law residuals are not orthogonal to the linear rig's columns, whose share in a second impact
    # that comes at once is nearly all of it
    problem = problem_of(session_of(with_law(), noise=0.02)).only((0, 5))
    fitted, again = fit(problem), at_work("double_hit", {"second_impulse_fraction": 0.02}).mechanism
    assert isinstance(again, SecondImpact)
    plain = second_impact_score(fitted, again)
    rng, moved = np.random.default_rng(4), []
    for number, residual in enumerate(fitted.residuals):
        q, _ = problem.nuisance().basis(fitted.modes[fitted.segments[number].group], fitted.segments[number])
        moved.append(residual + (q @ (10 * rng.standard_normal(q.shape[1]))).reshape(residual.shape))
    beside = second_impact_score(replace(fitted, residuals=tuple(moved)), again)
    assert beside.p_value == pytest.approx(plain.p_value, rel=1e-6)
    assert beside.delays == plain.delays
