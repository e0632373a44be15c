"""Laws that nobody listed: learned, read, and contesting what is listed; sessions integrated by SciPy."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from analysis.mismatch.answer import Answer
from analysis.mismatch.learning import is_learned
from mesotap.answers.diagnosis_json import diagnosis_json
from tests.analysis.ring_downs import LOADS_N, Record, diagnosed, session_of, two_mass, with_law
from tests.analysis.terms import listed
from tests.analysis.unlisted import at_upper_mass, in_contact

FEW = [listed(name) for name in ("hunt_crossley_damping", "hertz_stiffness", "quadratic_damping")]
RATIOS = (0.3, 0.6, 0.9)
SQUARE, ROOT = 8e12, 1.2e-4  # N/m2, and N at 1 mm/s


def quadratic(d: float, v: float, load: float) -> float:
    return SQUARE * d * d


def root_of_rate(d: float, v: float, load: float) -> float:
    return ROOT * math.copysign(math.sqrt(abs(v) / 1e-3), v)


@functools.cache
def answer_of(name: str) -> Answer:
    records: dict[str, Record] = {
        "quadratic": in_contact(quadratic),
        "root": at_upper_mass(root_of_rate),
        "hertz": with_law("hertz_stiffness"),
    }
    return diagnosed([session_of(records[name], ratios=RATIOS)], FEW, learn=True).answer


@pytest.mark.long
def test_a_force_of_the_squared_deflection_is_learned_with_its_exponents_and_coefficient() -> None:
    answer = answer_of("quadratic")
    assert answer.verdict == "new_physics"
    (found,) = answer.mechanisms
    law = found.law
    assert found.learned
    assert found.where == "contact"
    assert law is not None
    assert (law.kind, law.symmetry, law.conservative) == ("static", "even", True)
    n, q = law.exponents["deflection"], law.exponents["load"]
    assert n is not None
    assert n.low < 2.0 < n.high
    assert n.high - n.low < 1.0
    assert q is None or q.low < 0.0 < q.high
    best = law.formulas[0]
    assert best.values["deflection_exponent"] == 2.0
    assert best.values["load_exponent"] == 0.0
    force = best.parameters["force_n"]
    per_square = 1 / best.values["reference_deflection_m"] ** 2
    # of one session: twice the half width of a 95 % interval is as good as never exceeded
    assert abs(force.value * per_square - SQUARE) < 2 * (force.high - force.value) * per_square
    assert force.high - force.value < 0.02 * force.value


@pytest.mark.long
def test_the_curve_of_a_learned_law_holds_the_true_one_in_its_band() -> None:
    law = answer_of("quadratic").mechanisms[0].law
    assert law is not None
    assert law.table is not None
    d = law.table.axes["deflection_m"]
    half = (law.table.high - law.table.low) / 2
    assert np.all(np.abs(law.table.force_n - SQUARE * d**2) <= 2 * half + 1e-12)
    assert half.max() < 0.02 * np.abs(law.table.force_n).max()
    assert np.all(law.table.low <= law.table.force_n)
    assert np.all(law.table.force_n <= law.table.high)
    low, high = law.valid["deflection"]
    assert low == pytest.approx(d[0])
    assert high == pytest.approx(d[-1])


@pytest.mark.long
def test_held_out_impacts_get_better_with_a_learned_law_and_nothing_is_left() -> None:
    answer = answer_of("quadratic")
    assert answer.fit.heldout_rms_after is not None
    assert answer.fit.heldout_rms_after < 1.05 * answer.fit.noise_rms < answer.fit.heldout_rms_before
    assert answer.remainder.p_value > 0.01
    assert {m.id for m in FEW} & {i for r in answer.rivals for i in r.ids}
    assert all(not u.id.startswith("learned") for u in answer.upper_limits)


@pytest.mark.long
def test_a_force_of_the_root_of_the_rate_is_learned_where_it_acts() -> None:
    answer = answer_of("root")
    assert answer.verdict == "new_physics"
    law = answer.mechanisms[0].law
    assert law is not None
    assert law.kind == "rate"
    assert law.symmetry == "odd"
    assert law.conservative is False
    assert answer.mechanisms[0].where in ("upper mass", "tube springs")
    m = law.exponents["rate"]
    assert m is not None
    assert m.low < 0.5 < m.high


@pytest.mark.long
def test_a_listed_mechanism_is_named_and_no_law_is_learned_in_its_place() -> None:
    answer = answer_of("hertz")
    assert [m.id for m in answer.mechanisms] == ["hertz_stiffness"]
    assert answer.verdict == "missing_physics"
    assert not answer.mechanisms[0].learned
    assert answer.mechanisms[0].probability > 0.9


@pytest.mark.long
def test_the_answer_for_programs_tells_the_law_and_version_one_that_nothing_listed_explains() -> None:
    answer = answer_of("quadratic")
    told = diagnosis_json(answer, 0.0)
    law = told["mechanisms"][0]["law"]
    assert told["verdict"] == "new_physics"
    assert told["mechanisms"][0]["learned"] is True
    assert set(law) >= {"kind", "symmetry", "conservative", "exponents", "formulas", "valid", "table"}
    assert law["formulas"][0]["family"] == "even_power"
    assert diagnosis_json(answer, 0.0, 1)["verdict"] == "unexplained"


def test_a_listed_mechanism_is_no_learned_law() -> None:
    from tests.analysis.terms import at_work

    assert not is_learned(at_work("hertz_stiffness"))


@pytest.mark.long
@pytest.mark.parametrize("power", [1.7, 2.5])
def test_a_strong_contact_of_another_power_is_learned_with_it_and_the_stiffness_is_right(power: float) -> None:
    def force(d: float, v: float, load: float) -> float:
        stiffness = two_mass(load).kc
        pressed = max(1 + stiffness * d / (power * load), 0.0) ** power
        return load * (pressed - 1) - stiffness * d

    session = session_of(in_contact(force), noise=5e-3, ratios=(0.3, 0.5, 0.7, 0.9))
    found = diagnosed([session], FEW, learn=True)
    (named,) = found.answer.mechanisms
    assert named.id == "learned_static"
    assert named.law is not None
    exponent = named.law.exponents["deflection"]
    assert exponent is not None
    assert exponent.low < power < exponent.high
    assert exponent.high - exponent.low < 0.1
    assert found.selection.left.p_value > 0.01
    true = [two_mass(load).kc for load in LOADS_N]
    assert found.answer.fitted is not None
    assert [c.stiffness.value for c in found.answer.fitted.contact] == pytest.approx(true, rel=0.01)
    table, middle = named.law.table, LOADS_N[1]  # the reference is between the loads
    assert table is not None
    expected = [force(d, 0.0, middle) for d in table.axes["deflection_m"]]
    # of one session: twice the half width of a 95 % band is as good as never exceeded
    assert np.all(np.abs(table.force_n - expected) <= table.high - table.low + 1e-12)
    assert (table.high - table.low).max() < 0.02 * np.abs(expected).max()
