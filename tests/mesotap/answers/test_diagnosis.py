"""A diagnosis: its page, taken up by the simulated rig, and found again in what that rig records."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from analysis.mismatch.diagnosis import Diagnosis, diagnose_session
from daq.errors import RecordingError
from mesotap.answers.adoption import read_diagnosis, with_model
from mesotap.answers.diagnosis_files import diagnosis_answer
from mesotap.configuration.config import Config, ConfigError, load_config
from mesotap.report.diagnosis_report import contenders, write_diagnosis
from sim_backend.adopted import adopted
from sim_backend.mechanisms.mechanism import mechanisms
from sim_backend.twin import twin_record
from tests.analysis.ring_downs import FILTER, K1, M1, ONSET_S, RATE_HZ, SAMPLES, analog_filter, session_of, two_mass
from tests.mesotap.test_cli import mesotap, refused

HUNT_CROSSLEY, GROWTH = "hunt_crossley_damping", "damping_growth_per_relative_approach"
CONTEST = (HUNT_CROSSLEY, "hertz_stiffness", "squeeze_film", "quadratic_damping")
TRUE_GROWTH = 1.4
ANALOG = analog_filter(FILTER)


def damped(rig, load_n, pulse) -> np.ndarray:
    found = [adopted(HUNT_CROSSLEY, {GROWTH: TRUE_GROWTH})]
    return twin_record(rig, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, ANALOG)[0]


KNOWN = {name: mechanisms()[name] for name in CONTEST}


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose_session(session_of(damped), list(KNOWN.values()))


@pytest.fixture(scope="module")
def answer(found: Diagnosis) -> dict:
    return diagnosis_answer(found, 1.0)


@pytest.fixture
def diagnosis(answer: dict, tmp_path: Path) -> Path:
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(answer))
    return path


def test_what_the_rig_was_given_is_named_with_an_interval_that_holds_it(answer: dict) -> None:
    (named,) = answer["mechanisms"]
    assert named["id"] == HUNT_CROSSLEY
    assert named["parameters"][GROWTH]["low"] < TRUE_GROWTH < named["parameters"][GROWTH]["high"]


def test_the_page_says_what_where_and_why_not_and_needs_nothing_else(found: Diagnosis, answer: dict, tmp_path) -> None:
    page = write_diagnosis(tmp_path, found, answer, KNOWN, pdf_figures=False)
    text = page.read_text()
    assert json.loads((tmp_path / "diagnosis.json").read_text()) == answer
    assert f"it leaves out {HUNT_CROSSLEY.replace('_', ' ')}" in text
    assert all(f"{name}</" in text for name in CONTEST)  # a row in the contest's table
    assert "Struck from the list" in text
    assert text.count("<svg") == 6
    outside = set(re.findall(r"""(?:src|href)=["']([^#"'][^"']*)""", text))
    assert all(where.startswith("data:") for where in outside)


def test_the_contests_table_tells_the_named_one_from_the_others(found: Diagnosis) -> None:
    rows = {row.id: row for row in contenders(found.contest, KNOWN)}
    assert rows[HUNT_CROSSLEY].outcome == "named"
    assert all(not row.named and row.outcome for name, row in rows.items() if name != HUNT_CROSSLEY)


def test_the_contact_is_corrected_for_it(answer: dict) -> None:
    for load in answer["adopted"]["loads"]:
        true = two_mass(1e-3 * load["load_mn"])
        for key, value in (("contact_stiffness_n_per_m", true.kc), ("damping_ratio", true.modes()[3])):
            estimate = load[key]
            half = (estimate["high"] - estimate["low"]) / 2
            assert abs(estimate["value"] - value) < 2 * half


def test_the_simulated_rig_becomes_the_one_that_was_diagnosed(diagnosis: Path, answer: dict) -> None:
    config = with_model(Config(), read_diagnosis(diagnosis))
    (mechanism,) = config.sim_backend.mechanisms
    assert mechanism.parameters[GROWTH] == answer["mechanisms"][0]["parameters"][GROWTH]["value"]
    assert config.sim_backend.contact.load_mn == pytest.approx((200.0, 400.0, 800.0))
    assert config.rig.springs.k1_n_per_m == pytest.approx(K1, rel=0.02)
    assert config.rig.masses.m1_kg == pytest.approx(M1, rel=1e-3)


def test_adopt_writes_a_configuration_and_never_over_one(diagnosis: Path, tmp_path: Path) -> None:
    new = tmp_path / "twin.yaml"
    mesotap("adopt", str(diagnosis), "--output", str(new))
    assert load_config(new).sim_backend.mechanisms[0].id == HUNT_CROSSLEY
    assert "exists already" in refused("adopt", str(diagnosis), "--output", str(new))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"format": "mesotap-results"}, "is no mesotap-diagnosis 1"),
        ({"mechanisms": []}, "nothing to adopt"),
        ({"mechanisms": [{"id": "contact_loss"}]}, "is no complete mesotap-diagnosis 1"),
        ({"mechanisms": [{"id": "load_drift", "where": "load cell", "parameters": {}}]}, "nothing to adopt"),
        ({"mechanisms": [{"id": "magnetism", "parameters": {}}]}, "'magnetism' is no mechanism"),
        ({"mechanisms": [{"id": HUNT_CROSSLEY, "parameters": {}}]}, f"needs {GROWTH}"),
    ],
)
def test_what_cannot_be_adopted_is_refused_in_a_sentence(diagnosis: Path, answer, change, sentence) -> None:
    diagnosis.write_text(json.dumps(answer | change))
    with pytest.raises((RecordingError, ConfigError)) as refusal:
        with_model(Config(), read_diagnosis(diagnosis))
    assert sentence in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_file_that_is_no_diagnosis_ends_with_code_2(tmp_path: Path) -> None:
    assert "there is no such file" in refused("adopt", str(tmp_path / "nothing.json"))


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.sampled_from(["contact_loss", "load cell", HUNT_CROSSLEY]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["id", "parameters", "fixed", "where", "value", "loads", "rig", "k1"]), inner)
    ),
    max_leaves=12,
)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(mechanisms=JSON, augmented=JSON)
def test_any_json_is_adopted_or_refused_in_a_sentence(tmp_path: Path, mechanisms, augmented) -> None:
    path = tmp_path / "any.json"
    head = {"format": "mesotap-diagnosis", "version": 1}
    path.write_text(json.dumps(head | {"mechanisms": mechanisms, "adopted": augmented}))
    try:
        with_model(Config(), read_diagnosis(path))
    except (RecordingError, ConfigError) as refusal:
        assert str(path) in str(refusal)
