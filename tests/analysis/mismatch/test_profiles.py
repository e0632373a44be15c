"""The ends of an interval that is read off the profile of chi-squared."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from analysis.mismatch import intervals
from analysis.mismatch.intervals import ENOUGH, NORMAL_95, _end
from sim_backend.mechanisms.kinds import Quantity

MASS = Quantity("mass_kg", "kg", 0.0, 10.0, "a mass", log=True)


def at(mass: float, objective: float) -> Any:
    return SimpleNamespace(objective=objective, terms=[SimpleNamespace(values={"mass_kg": mass})])


@pytest.mark.parametrize("surest", [math.log(1.7), math.log(2.5), math.inf])
def test_a_fit_that_ended_in_a_wrong_minimum_is_no_end(surest: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps along the profile that are longer than ``surest`` end far off, as fits do that begin too far away."""
    end = 40.0  # times the estimate

    def fixed(fitted: Any, number: int, along: Quantity, factor: float, before: Any) -> Any:
        mass = fitted.terms[number].values["mass_kg"] * factor
        root = NORMAL_95 * math.log(mass) / math.log(end)
        return at(mass, root**2 if abs(math.log(factor)) < surest else 1e4)

    monkeypatch.setattr(intervals, "_fixed_at", fixed)
    found, _, _ = _end(at(1.0, 0.0), 0, MASS, 1.0, 0.0)
    assert found is not None
    assert abs(NORMAL_95 * math.log(found["mass_kg"]) / math.log(end) - NORMAL_95) < ENOUGH
