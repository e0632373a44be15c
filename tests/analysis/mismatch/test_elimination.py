"""Linear equations of the fits."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.elimination import eliminated, solved


def test_the_smallest_of_several_solutions() -> None:
    a, b = np.array([[1.0, 1.0], [2.0, 2.0]]), np.array([2.0, 4.0])
    assert solved(a, b, rcond=1e-12) == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_of_numbers_that_are_not_finite_lapack_prints_nothing(wrong: float, capfd: pytest.CaptureFixture[str]) -> None:
    assert np.isnan(solved(np.eye(2), np.array([1.0, wrong]), rcond=1e-12)).all()
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        solved(np.diag([1.0, wrong]), np.ones(2), rcond=1e-12)
    assert capfd.readouterr().out == ""


def test_an_unknown_taken_out_leaves_the_schur_complement() -> None:
    gram = np.array([[4.0, 2.0], [2.0, 3.0]])
    assert eliminated(gram, 1, np.zeros(1)) == pytest.approx(np.array([[2.0]]))
    assert eliminated(gram, 1, np.array([4.0])) == pytest.approx(np.array([[2.5]]))
