"""How a learned law is drawn."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from analysis.mismatch.free_form import STATIC, free_law
from analysis.mismatch.law_reading import _Read, _table
from analysis.mismatch.parameters import Term
from mesotap.configuration.rig_files import parse_rig
from sim_backend.learned.families import form_of, learned_mechanisms
from sim_backend.mechanisms.kinds import Scale
from tests.analysis.mismatch.recordings.described_rigs import INPUT, SPRING, sensor

REACH, RATE, FORCE = 0.01, 0.5, 20.0  # m, m/s, N
STANDARD_ERROR = 0.05  # N
RIG = parse_rig(SPRING + INPUT + sensor("displacement")).arrangement
VALID = {"deflection": (-REACH, REACH), "rate": (-RATE, RATE)}


def read(term: Term) -> _Read:
    """A law that was fitted, known but for its force."""
    spread = np.zeros((len(term.mechanism.parameters),) * 2)
    spread[0, 0] = STANDARD_ERROR**2
    values = {p.name: 1.0 for p in RIG.parameters}
    constants = SimpleNamespace(at=lambda group: values, names=lambda: ((), ()))
    fitted = SimpleNamespace(
        terms=(term,),
        term_covariances=(spread,),
        constants=constants,
        arrangement=RIG,
        problem=SimpleNamespace(rig=SimpleNamespace(preload_n=0.0)),
    )
    return _Read(fitted, 0, 0.0, {})  # type: ignore[arg-type]


def square() -> _Read:
    """An odd square of the deflection."""
    for mechanism in learned_mechanisms():
        if mechanism.id != "learned_static":
            continue
        scale = Scale(REACH, RATE, 0.0, FORCE, (1.0, 10.0), 10.0, 1.0, 100.0)
        for values in mechanism.trials(scale):
            if form_of(values).symmetry == "odd" and values.get("deflection_exponent") == 2.0:
                return read(Term(mechanism, {**values, "force_n": FORCE}, (0,)))
    raise AssertionError("no odd square among the families")


def any_shape(law: _Read, **shares: float) -> _Read:
    scale = Scale(REACH, RATE, 0.0, FORCE, (1.0, 10.0), 10.0, 1.0, 100.0)
    term = free_law(law.term, RIG, scale, STATIC)
    return read(Term(term.mechanism, {**term.values, **dict.fromkeys(STATIC, 0.0), **shares}, (0,)))


def test_a_law_is_drawn_as_it_is_stated_although_a_force_of_any_shape_trades_with_the_spring() -> None:
    law = square()
    at = law.term.values["reference_deflection_m"]
    true = FORCE * (REACH / at) ** 2
    alone = _table(law, VALID, None)
    with_free = _table(law, VALID, any_shape(law, abs_d_d=true, d_small=300.0))
    assert alone is not None
    assert with_free is not None
    d = alone.axes["deflection_m"]
    assert alone.force_n == pytest.approx(true * np.abs(d / REACH) * d / REACH, abs=1e-6 * true)
    assert with_free.force_n == pytest.approx(alone.force_n)
    assert np.all(with_free.low <= alone.low)
    assert np.all(with_free.high >= alone.high)


def test_the_band_holds_a_shape_that_explains_better_than_any_formula() -> None:
    law = square()
    true = FORCE * (REACH / law.term.values["reference_deflection_m"]) ** 2
    table = _table(law, VALID, any_shape(law, abs_d_d=true, d5=0.3 * true))
    assert table is not None
    u = table.axes["deflection_m"] / REACH
    more = 0.3 * true * u**5
    line = np.polynomial.Polynomial.fit(u, more, 1)
    other = table.force_n + more - line(u)
    assert np.all((table.low <= other + 1e-9) & (other <= table.high + 1e-9))
    assert np.max(table.high - table.low) > 0.1 * true  # of the law alone: a hundredth of it
