"""Labels of loads, and how likely something unlisted is."""

from __future__ import annotations

import pytest

from analysis.mismatch.account import group_labels, odds_of_unlisted
from analysis.mismatch.policy import POLICY
from tests.analysis.terms import listed


@pytest.mark.parametrize(
    ("loads", "labels"),
    [
        ([0.2504, 0.1042], {"104 mN": 0.1042, "250 mN": 0.2504}),
        ([0.10401, 0.10419, 0.10401], {"104.0 mN": 0.10401, "104.2 mN": 0.10419}),
    ],
)
def test_labels_tell_loads_apart(loads: list[float], labels: dict[str, float]) -> None:
    assert group_labels(loads) == labels


def test_what_is_weak_or_a_body_may_well_be_something_that_is_not_listed() -> None:
    law, body = listed("hertz_stiffness"), listed("attached_mass")
    odds = [odds_of_unlisted(POLICY, gain, law) for gain in (10.0, 400.0, 900.0, 1e6)]
    assert odds[0] == odds[1] == pytest.approx(POLICY.unlisted + POLICY.strong_likeness)
    assert odds[1] > odds[2] > odds[3] == pytest.approx(POLICY.strong_likeness, rel=0.01)
    assert odds_of_unlisted(POLICY, 1e6, body) == POLICY.unlisted
