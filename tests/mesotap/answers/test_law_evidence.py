"""What the page of a diagnosis tells of a learned law."""

from __future__ import annotations

import pytest

from analysis.mismatch.answer import Formula, Interval, Law
from mesotap.answers.law_evidence import exponent_told

POWER = "P * (max(1 + k * d / (2.2 * P), 0)**2.2 - 1) - k * d, k the stiffness under the load P"


def law(formula: str) -> Law:
    exponents = {"deflection": Interval(2.2, 2.196, 2.203, "1"), "rate": None, "load": None}
    return Law("static", "none", True, exponents, (Formula(formula, {}, 60.0, "some", {}),), {}, None)


@pytest.mark.parametrize(
    ("name", "formula", "told"),
    [
        ("deflection", POWER, "2.2000 (2.1960 to 2.2030)"),
        ("rate", POWER, "it does not depend on it"),
        ("load", POWER, "it is no power of it alone"),
        ("load", "0.0087 N * (d / 1.8e-08 m)**2", "it does not depend on it"),
    ],
)
def test_an_exponent_is_told_as_the_formula_has_it(name: str, formula: str, told: str) -> None:
    assert str(exponent_told(law(formula), name)) == told
