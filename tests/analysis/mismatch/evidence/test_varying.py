"""The contact's constants let free in windows of time and amplitude."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest

from analysis.mismatch.evidence.varying import Varying, contact_by_amplitude, contact_in_time
from analysis.mismatch.ring_downs.fit import RingDownFit, fit
from tests.analysis.ring_downs import problem_of, session_of, two_mass, with_law


@functools.cache
def fitted(*laws: str) -> RingDownFit:
    return fit(problem_of(session_of(with_law(*laws), noise=0.01)))


@pytest.mark.parametrize("windows", [contact_in_time, contact_by_amplitude])
def test_a_linear_contact_is_the_same_in_every_window(windows: Callable[[RingDownFit], tuple[Varying, ...]]) -> None:
    for one in windows(fitted()):
        assert one.middle.size >= 3
        assert np.all(np.abs(one.stiffness) < 4.5 * one.stiffness_error)
        ratio = two_mass(one.load_n).cc / (2 * np.sqrt(two_mass(one.load_n).kc * 0.107 * 0.108 / 0.215))
        assert np.all(np.abs(one.damping_ratio - ratio) < 4.5 * one.damping_ratio_error)


def test_a_hertzian_contact_softens_with_amplitude_and_stiffens_with_time() -> None:
    strongest = contact_by_amplitude(fitted("hertz_stiffness"))[-1]
    assert strongest.stiffness[-1] < -10 * strongest.stiffness_error[-1]
    assert strongest.stiffness[-1] < strongest.stiffness[len(strongest.stiffness) // 2]
    in_time = contact_in_time(fitted("hertz_stiffness"))[-1]
    assert in_time.stiffness[0] < in_time.stiffness[-1]
