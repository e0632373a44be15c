"""What the page of a diagnosis tells of a learned law."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.answer import Formula, Interval, Law, LawTable, Named
from mesotap.answers.diagnosis_text import curve_words, told_parameters
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


def curve(*axes: str) -> Named:
    """A learned curve, of a force that is ten times its first axis, or that times the second one."""
    along = {axis: np.linspace(-2.0, 2.0, 21) for axis in axes}
    force = 10.0 * along[axes[0]]
    force = force if len(axes) == 1 else np.outer(force, along[axes[1]])
    table = LawTable(along, force, force - 1.0, force + 1.0)
    law = Law("static", "none", True, {"deflection": None, "rate": None, "load": None}, (), {}, table, "curve_7")
    bends = {f"bend_{i + 1}": Interval(1.0, 0.9, 1.1, "N") for i in range(7)}
    return Named("learned_static", "spring", 0.9, "A curve.", bends, (), law=law)


def test_of_a_curve_points_are_told_and_not_its_bends() -> None:
    told = curve_words(curve("deflection_m"))
    assert told_parameters(curve("deflection_m")) == {}
    assert len(told) == 9
    assert told[0] == "deflection -2.000 m: force -20.00 (-21.00 to -19.00) N"


def test_of_a_damping_the_force_at_the_largest_rate_is_told() -> None:
    told = curve_words(curve("deflection_m", "rate_m_per_s"))
    assert told[-1] == "deflection 2.000 m at the largest rate: force 40.00 (39.00 to 41.00) N"


def test_a_curve_is_no_power_of_what_it_is_a_curve_of() -> None:
    law = curve("deflection_m").law
    assert law is not None
    assert str(exponent_told(law, "deflection")) == "it is no power of it"
    assert str(exponent_told(law, "load")) == "it does not depend on it"
