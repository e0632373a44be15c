"""Labels of loads."""

from __future__ import annotations

import pytest

from analysis.mismatch.account import group_labels


@pytest.mark.parametrize(
    ("loads", "labels"),
    [
        ([0.2504, 0.1042], {"104 mN": 0.1042, "250 mN": 0.2504}),
        ([0.10401, 0.10419, 0.10401], {"104.0 mN": 0.10401, "104.2 mN": 0.10419}),
    ],
)
def test_labels_tell_loads_apart(loads: list[float], labels: dict[str, float]) -> None:
    assert group_labels(loads) == labels
