"""The answer about a described rig, from recordings by another integrator than the one that diagnoses them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from analysis.mismatch.answer import Interval, RecordingFile
from analysis.mismatch.diagnosis import Diagnosis, diagnose_recordings
from mesotap.answers.diagnosis_json import diagnosis_json
from mesotap.answers.diagnosis_page import write_page
from mesotap.answers.evidence import evidence_of
from mesotap.answers.recording_evidence import _declared, _interval
from mesotap.configuration.rig_files import parse_rig
from sim_backend.arrangement import Parameter
from sim_backend.mechanisms.catalogue import catalogue, variants
from tests.analysis.mismatch.recordings.described_rigs import motion, noise_input, recorded

pytestmark = pytest.mark.slow  # every test needs a diagnosis

SAMPLES, RATE, OMEGA, CUBIC = 2400, 200.0, 2 * np.pi * 12, 8.0
KNOWN = {k: catalogue()[k][-1:] for k in ("tube_spring_cubic", "quadratic_damping", "guide_friction")}
RIG = """
name: bench
bodies: {mass: 1}
springs: [{between: [mass, ground], damping: unknown, name: leaf}]
inputs: [{channel: 0, force_on: mass, gain: unknown}]
sensors: [{channel: 1, of: mass, shows: displacement, unit: m}]
"""
SCHEMA = json.loads((Path(__file__).parents[2] / "contracts" / "diagnosis-2.schema.json").read_text(encoding="utf-8"))


def diagnosed(cubic: float) -> Diagnosis:
    u = noise_input(SAMPLES, RATE, 2, 25, seed=3)
    y = motion(
        lambda s, x, v: 100 * s - OMEGA**2 * x * (1 + cubic * x * x) - 0.04 * OMEGA * v, [0.0, 0.0], SAMPLES, RATE, u
    )
    recording, files = recorded([u, y[0]], RATE, 0.01), [RecordingFile("made.csv", "0" * 64)]
    return diagnose_recordings([recording], parse_rig(RIG), variants(KNOWN), files=files)


@pytest.fixture(scope="module")
def hardening() -> Diagnosis:
    return diagnosed(CUBIC)


@pytest.fixture(scope="module")
def linear() -> Diagnosis:
    return diagnosed(0.0)


@pytest.mark.parametrize("case", ["hardening", "linear"])
def test_it_fits_the_contract(case: str, request: pytest.FixtureRequest) -> None:
    content = json.loads(json.dumps(diagnosis_json(request.getfixturevalue(case).answer, 1.0), allow_nan=False))
    jsonschema.Draft202012Validator(SCHEMA).validate(content)


def test_a_mechanism_is_named_with_the_element_it_acts_in(hardening: Diagnosis) -> None:
    (named,) = hardening.answer.mechanisms
    assert (named.id, named.where, named.element) == ("tube_spring_cubic", "spring", "leaf")


def test_nothing_is_left_of_what_one_cubic_spring_made(hardening: Diagnosis) -> None:
    remainder = hardening.answer.remainder
    assert remainder.p_value > 1e-3
    assert remainder.where is None
    assert remainder.share < 0.01


def test_the_limits_of_a_linear_rig_are_far_below_what_would_be_seen(linear: Diagnosis) -> None:
    limits = {u.id: u.value for u in linear.answer.upper_limits}
    assert set(limits) == set(KNOWN)
    assert limits["tube_spring_cubic"] < 0.05 * CUBIC * OMEGA**2  # N/m3


def test_the_page_leaves_out_what_this_experiment_has_not(hardening: Diagnosis, tmp_path) -> None:
    answer = hardening.answer
    page = write_page(tmp_path, answer, evidence_of(hardening, KNOWN), diagnosis_json(answer, 1.0), pdf_figures=False)
    text = page.read_text(encoding="utf-8")
    assert "it leaves out tube spring cubic" in text
    assert "Upper limits" in text
    assert "The missing force" not in text
    assert "mN" not in text


def test_each_fitted_constant_has_an_interval_and_each_declared_one_its_uncertainty(linear: Diagnosis) -> None:
    behind = evidence_of(linear, KNOWN)
    assert behind.meanings["guide_friction", "friction_force_n"] == "friction force"
    assert all(behind.meanings.values())
    (table,) = behind.constants
    assert table.headings == ("Constant", "Value", "95 % interval", "Unit", "Declared")
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["mass of mass"] == ("1.0000", "not fitted", "kg", "1.0000, exactly")
    for name, true, unit in (("stiffness of leaf", OMEGA**2, "N/m"), ("damping of leaf", 0.04 * OMEGA, "N s/m")):
        value, interval, shown, declared = rows[name]
        low, high = map(float, interval.split(" to "))
        assert low < float(value) < high
        assert low * 0.99 < true < high * 1.01
        assert high / low < 1.05
        assert (shown, declared) == (unit, "unknown")


def test_what_is_declared_within_an_error_is_shown_with_it() -> None:
    assert _declared(Parameter("k", "N/m", 800.0, 5.0)) == "800.00 ± 10"
    assert _declared(Parameter("k", "N/m", 800.0, 0.0)) == "800.00, exactly"
    assert _declared(Parameter("k", "N/m", math.nan)) == "unknown"
    assert _interval(Interval(1.0, 0.0, math.inf, "N/m")) == "not determined by these recordings"
