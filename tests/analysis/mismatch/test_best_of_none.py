"""What is said of the best candidates where none of them is named."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from analysis.mismatch.answer import Answer
from analysis.mismatch.diagnosis import answer_of
from analysis.mismatch.ring_downs.account import ImpactAccount
from analysis.mismatch.ring_downs.selecting import select_for_impacts
from analysis.mismatch.selection import Selection
from tests.analysis.ring_downs import problem_of, session_of, with_law
from tests.analysis.terms import listed


@functools.cache
def found() -> tuple[Answer, Selection]:
    """Return the answer, and the selection, where Hertz' law is at work and not listed."""
    problem = problem_of(session_of(with_law("hertz_stiffness"), noise=0.02))
    known = [listed(name) for name in ("hunt_crossley_damping", "tube_spring_cubic", "sensor_curvature")]
    with np.errstate(all="ignore"):
        selection, _ = select_for_impacts(problem, known, lambda text: None)
        return answer_of(ImpactAccount(selection)), selection


@pytest.mark.long
def test_the_best_two_are_given_their_error_on_what_was_held_out() -> None:
    answer, selection = found()
    assert answer.verdict == "unexplained"
    first, second = answer.rivals[:2]
    fitted = list(dict.fromkeys(c.id for c in selection.steps[0].candidates if c.fit is not None))
    assert [first.ids, second.ids] == [(fitted[0],), (fitted[1],)]
    assert first.heldout_rms is not None
    assert second.heldout_rms is not None
    # neither is what is at work, so both stay far from the noise
    for rival in (first, second):
        assert answer.fit.noise_rms < rival.heldout_rms < 1.5 * answer.fit.heldout_rms_before
    assert first.why == "It explains more than any other, but leaves too much over to be named."
    smaller = second.heldout_rms < first.heldout_rms
    assert ("Its held-out error is smaller all the same" in second.why) is smaller


@pytest.mark.long
def test_the_error_is_that_of_a_fit_as_what_is_named_is_fitted() -> None:
    answer, selection = found()
    judge = selection.judge
    for rival in answer.rivals[:2]:
        candidate = next(c for c in selection.steps[0].candidates if (c.id,) == rival.ids)
        again = judge.held_out_rms(judge.to_the_end(candidate.fit))[0]
        assert rival.heldout_rms == pytest.approx(again, rel=1e-6)
