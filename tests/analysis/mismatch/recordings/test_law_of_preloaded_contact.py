"""A law learned in a contact that a described rig preloads is read under that preload."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.mismatch.law_reading import force_on
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.constants import constant_intervals, constants_covariance
from analysis.mismatch.recordings.linear_rig import linear_fit, problem_of
from analysis.mismatch.recordings.recorded import prepare
from mesotap.configuration.rig_files import parse_rig
from sim_backend.learned.families import form_named
from sim_backend.learned.forms import AT_DEFLECTION, AT_LOAD, AT_RATE, FORM, IN_DEFLECTION
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.test_contact_turned_round import PRELOAD, described, pressed


def test_a_power_of_the_approach_is_that_of_the_preload() -> None:
    """Without the preload it was a division by zero, and no answer."""
    rig = parse_rig(described("[ground, ball]"))
    fitted = linear_fit(problem_of(rig, [prepare(pressed(0.3), rig)]))
    form = form_named("power_of_approach")
    assert form.loaded is not None
    values = {FORM: float(form.number), AT_DEFLECTION: 1e-5, AT_RATE: 1e-3, AT_LOAD: PRELOAD, IN_DEFLECTION: 1.5}
    law = Term(form.loaded, values, (0,))
    d = np.linspace(-2e-5, 2e-5, 5)
    k = fitted.values["stiffness of pair"]
    expected = PRELOAD * ((1 + k * d / (1.5 * PRELOAD)) ** 1.5 - 1) - k * d
    assert force_on(fitted, law, law, {"deflection_m": d}) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_the_covariance_of_constants_is_that_of_their_intervals() -> None:
    rig = parse_rig(described("[ground, ball]"))
    fitted = linear_fit(problem_of(rig, [prepare(pressed(0.3), rig)]))
    names, covariance = constants_covariance(fitted)
    error = dict(zip(names, np.sqrt(np.diag(covariance)), strict=True))
    for name in ("stiffness of pair", "damping of pair"):
        low, high = constant_intervals(fitted)[name]
        assert 2 * 1.96 * error[name] == pytest.approx(high - low, rel=0.01)


@pytest.mark.long
def test_without_hertz_its_law_is_learned_under_the_preload() -> None:
    known = [m for m in variants(catalogue()) if m.id in ("tube_spring_cubic", "quadratic_damping", "guide_friction")]
    answer = diagnose_recordings([pressed(2.0)], parse_rig(described("[ground, ball]")), known).answer
    assert answer.verdict == "new_physics"
    law = answer.mechanisms[0].law
    assert law is not None
    exponent = law.exponents["deflection"]
    assert exponent is not None
    assert exponent.low < 1.5 < exponent.high
    assert law.exponents["load"] is None
    assert "load_exponent" not in answer.mechanisms[0].parameters
    assert law.table is not None
    assert np.all(law.table.low <= law.table.force_n)
    assert np.all(np.isfinite(law.table.low))
