"""A law learned in a contact that a described rig preloads is read under that preload."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.law_reading import force_on
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import linear_fit, problem_of
from analysis.mismatch.recordings.recorded import prepare
from mesotap.configuration.rig_files import parse_rig
from sim_backend.learned.families import form_named
from sim_backend.learned.forms import AT_DEFLECTION, AT_LOAD, AT_RATE, FORM, IN_DEFLECTION
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
