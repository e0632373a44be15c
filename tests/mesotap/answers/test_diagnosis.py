"""A diagnosis: its page, taken up by the simulated rig, and found again in what that rig records."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from analysis.mismatch.answer import Answer, RecordingFile
from analysis.mismatch.diagnosis import Diagnosis, diagnose
from daq.errors import RecordingError
from mesotap.answers import impact_evidence
from mesotap.answers.adoption import AdoptedModel, read_diagnosis, with_model
from mesotap.answers.candidates import candidates
from mesotap.answers.diagnosis_json import diagnosis_json
from mesotap.answers.diagnosis_page import write_page
from mesotap.answers.evidence import evidence_of
from mesotap.configuration.config import Config, ConfigError, load_config, parse_config
from sim_backend.adopted import adopted
from sim_backend.mechanisms.catalogue import variants
from sim_backend.twin import twin_record
from tests.analysis.ring_downs import (
    FILTER,
    K1,
    K2,
    M1,
    M2,
    ONSET_S,
    PRETRIGGER,
    RATE_HZ,
    SAMPLES,
    analog_filter,
    session_of,
    two_mass,
)
from tests.analysis.terms import listed
from tests.mesotap.answers.test_consistent_page import ADVERBS, Page, is_rounded
from tests.mesotap.test_cli import mesotap, refused
from tests.mesotap.tester import diagnosed, problem_of

HUNT_CROSSLEY, GROWTH = "hunt_crossley_damping", "damping_growth_per_relative_approach"
CONTEST = (HUNT_CROSSLEY, "hertz_stiffness", "squeeze_film", "quadratic_damping")
TRUE_GROWTH = 1.4
ANALOG = analog_filter(FILTER)
CONTRACTS = Path(__file__).parents[2] / "contracts"


def damped(rig, load_n, pulse) -> np.ndarray:
    found = [adopted(HUNT_CROSSLEY, {GROWTH: TRUE_GROWTH})]
    return twin_record(rig, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, ANALOG)[0]


KNOWN = {name: (listed(name),) for name in CONTEST}


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnosed(session_of(damped), variants(KNOWN), [RecordingFile("made", "0" * 64)])


@pytest.fixture(scope="module")
def said(found: Diagnosis) -> Answer:
    return found.answer


@pytest.fixture(scope="module")
def answer(said: Answer) -> dict:
    return diagnosis_json(said, 1.0)


@pytest.fixture(params=[1, 2])
def diagnosis(request: pytest.FixtureRequest, said: Answer, tmp_path: Path) -> Path:
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(diagnosis_json(said, 1.0, request.param)))
    return path


def test_what_the_rig_was_given_is_named_with_an_interval_that_holds_it(answer: dict) -> None:
    (named,) = answer["mechanisms"]
    assert named["id"] == HUNT_CROSSLEY
    assert named["parameters"][GROWTH]["low"] < TRUE_GROWTH < named["parameters"][GROWTH]["high"]


@pytest.mark.parametrize("version", [1, 2])
def test_the_answer_fits_the_contract(said: Answer, version) -> None:
    schema = json.loads((CONTRACTS / f"diagnosis-{version}.schema.json").read_text())
    text = json.dumps(diagnosis_json(said, 1.0, version), allow_nan=False)
    jsonschema.Draft202012Validator(schema).validate(json.loads(text))


def test_what_is_not_named_and_not_there_has_a_low_limit(answer: dict) -> None:
    limits = {u["id"]: u["value"] for u in answer["upper_limits"]}
    assert set(limits) == {"squeeze_film", "quadratic_damping"}  # Hertz's law has no strength
    assert limits["squeeze_film"] < 0.1  # of c_c


@pytest.mark.slow
def test_the_limit_of_what_is_too_weak_to_be_seen_holds_its_true_strength() -> None:
    weak = 0.004

    def hardly_damped(rig, load_n, pulse) -> np.ndarray:
        found = [adopted(HUNT_CROSSLEY, {GROWTH: weak})]
        return twin_record(rig, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, ANALOG)[0]

    answer = diagnosed(session_of(hardly_damped), variants(KNOWN)).answer
    (limit,) = (u for u in answer.upper_limits if u.id == HUNT_CROSSLEY)
    assert answer.verdict == "consistent"
    assert weak < limit.value < 10 * weak


def test_the_runner_up_is_told_of(answer: dict) -> None:
    first = answer["rivals"][0]
    assert first["ids"] != [HUNT_CROSSLEY]
    assert first["probability"] < answer["mechanisms"][0]["probability"]
    assert first["heldout_rms"] >= answer["fit"]["heldout_rms_after"]
    assert first["why"].startswith("Fitted, it has an evidence of at least ")  # true of a fit that was given up, too


@pytest.mark.long
def test_the_runner_up_is_fitted_in_full_even_where_its_score_promises_little(tmp_path: Path) -> None:
    def stiffening(rig, load_n, pulse) -> np.ndarray:
        return twin_record(rig, load_n, [adopted("hertz_stiffness", {})], pulse, ONSET_S, SAMPLES, RATE_HZ, ANALOG)[0]

    problem = problem_of(session_of(stiffening))
    strict = replace(problem, policy=replace(problem.policy, close=1.0))  # nothing comes close by its score
    found = diagnose(strict, variants(KNOWN))
    answer = diagnosis_json(found.answer, 1.0)
    rival = answer["rivals"][0]
    assert [m["id"] for m in answer["mechanisms"]] == ["hertz_stiffness"]
    assert rival["heldout_rms"] > answer["fit"]["heldout_rms_after"]
    assert rival["why"].startswith(("Fitted, it has an evidence of at least ", "Fitted, it has no evidence "))
    text = write_page(tmp_path, found.answer, evidence_of(found, KNOWN), answer, pdf_figures=False).read_text()
    page = Page()
    page.feed(text)
    name, _, error, _ = page.table("Instead", "Held-out rms")[1]
    assert name == rival["ids"][0]
    assert is_rounded(error, rival["heldout_rms"])
    (row,) = (r for r in page.table("Mechanism", "Fit", "Outcome")[1:] if r[0] == name)
    assert all(cell not in ("", "–") for cell in row)
    assert not ADVERBS.search(re.sub(r"<[^>]*>", " ", text))


@pytest.mark.slow
def test_the_page_says_what_where_and_why_not_and_needs_nothing_else(
    found: Diagnosis, said: Answer, answer: dict, tmp_path: Path
) -> None:
    page = write_page(tmp_path, said, evidence_of(found, KNOWN), answer, pdf_figures=False)
    text = page.read_text()
    assert json.loads((tmp_path / "diagnosis.json").read_text()) == answer
    assert f"it leaves out {HUNT_CROSSLEY.replace('_', ' ')}" in text
    assert all(f"{name}</" in text for name in CONTEST)  # a row in the table of candidates
    assert "Excluded from the list" in text
    assert text.count("<svg") == 6
    words = re.sub(r"<[^>]*>", "", re.sub(r"(?s)<(svg|style).*?</\1>", "", text))
    assert not re.findall(r"\d[eE][+-]\d|[km]/s2|\bk_c\b|\bzeta2\b|[ (]-\d", words)  # one notation for each
    outside = set(re.findall(r"""(?:src|href)=["']([^#"'][^"']*)""", text))
    assert all(where.startswith("data:") for where in outside)


def test_what_is_only_the_best_there_is_is_not_called_what_was_left_out(found: Diagnosis) -> None:
    named, unnamed = found.selection, replace(found.selection, chosen=None)
    for selection, head in ((named, "With what was left out"), (unnamed, "With hunt crossley damping (not named)")):
        assert impact_evidence._constants(selection).headings[-1] == head
    contact = impact_evidence._contact(unnamed)
    assert "which is not named" in contact.caption
    assert contact.headings[-1].endswith(", with it")


@pytest.mark.parametrize(("uncertainties", "marked"), [(0.0, False), (2.9, False), (-14.6, True)])
def test_a_declared_constant_that_ends_far_off_is_marked(found: Diagnosis, uncertainties: float, marked: bool) -> None:
    best = found.selection.best
    (m1,) = (p for p in best.problem.arrangement.parameters if p.name == "m1")
    at = best.constants.names()[0].index("m1")
    rig = best.constants.rig.copy()
    rig[at] = m1.value + uncertainties * m1.uncertainty
    moved = replace(best, constants=replace(best.constants, rig=rig))
    row = impact_evidence._constants(replace(found.selection, best=moved)).rows[at]
    assert ("15 uncertainties off" in row[-1]) == marked
    assert "off" not in row[-2]  # of Eq. 9


def test_the_table_of_candidates_tells_the_named_one_from_the_others(found: Diagnosis) -> None:
    rows = {row.id: row for row in candidates(found.selection, KNOWN)}
    assert rows[HUNT_CROSSLEY].outcome == "named"
    assert all(not row.named and row.outcome for name, row in rows.items() if name != HUNT_CROSSLEY)


def test_the_contact_is_corrected_for_it(answer: dict) -> None:
    for load in answer["fitted"]["loads"]:
        true = two_mass(1e-3 * load["load_mn"])
        for key, value in (("contact_stiffness_n_per_m", true.kc), ("damping_ratio", true.modes()[3])):
            estimate = load[key]
            half = (estimate["high"] - estimate["low"]) / 2
            assert abs(estimate["value"] - value) < 2 * half


def test_the_rigs_constants_have_intervals_that_hold_what_was_simulated(answer: dict) -> None:
    for name, true in {"m1": M1, "m2": M2, "k1": K1, "k2": K2}.items():
        found = answer["fitted"]["rig"][name]
        half = (found["high"] - found["low"]) / 2
        assert 0 < half < 0.05 * true
        assert abs(found["value"] - true) < 2 * half
    assert answer["fitted"]["off_declared"] == {}


def test_the_place_in_time_ends_with_the_records(answer: dict) -> None:
    first, last = answer["location"]["time_s"]
    assert 0 < first < last <= (SAMPLES - PRETRIGGER) / RATE_HZ


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
        ({"format": "mesotap-results"}, "is not a mesotap-diagnosis 1 or 2"),
        ({"version": 3}, "is not a mesotap-diagnosis 1 or 2"),
        ({"version": True}, "is not a mesotap-diagnosis 1 or 2"),
        ({"rig": "beam"}, "is of another rig than the two-mass tester"),
        ({"mechanisms": []}, "nothing to adopt"),
        ({"mechanisms": [{"id": "contact_loss"}]}, "is not a complete mesotap-diagnosis 2"),
        ({"mechanisms": [{"id": "load_drift", "where": "load cell", "parameters": {}}]}, "nothing to adopt"),
        ({"mechanisms": [{"id": "magnetism", "parameters": {}}]}, "unknown mechanism 'magnetism'"),
        ({"mechanisms": [{"id": HUNT_CROSSLEY, "parameters": {}}]}, f"needs {GROWTH}"),
    ],
)
def test_what_cannot_be_adopted_is_refused_in_a_sentence(tmp_path: Path, answer, change, sentence) -> None:
    diagnosis = tmp_path / "edited.json"
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
@given(mechanisms=JSON, augmented=JSON, version=st.sampled_from([1, 2]))
def test_any_json_is_adopted_or_refused_in_a_sentence(tmp_path: Path, mechanisms, augmented, version) -> None:
    path = tmp_path / "any.json"
    head = {"format": "mesotap-diagnosis", "version": version, "rig": "two-mass tester"}
    key = {1: "adopted", 2: "fitted"}[version]
    path.write_text(json.dumps(head | {"mechanisms": mechanisms, key: augmented}))
    try:
        with_model(Config(), read_diagnosis(path))
    except (RecordingError, ConfigError) as refusal:
        assert str(path) in str(refusal)


def test_adopted_masses_are_declared_without_what_moves_of_the_tube_springs():
    config = parse_config("rig: {springs: {system_resonance_hz: 356, added_mass_kg: 0.0027}}")
    model = AdoptedModel("d.json", {}, (), {"m1": 0.1097, "m2": 0.1107, "k1": 5.4e5, "k2": 5.4e5})
    assert with_model(config, model).rig.masses.m1_kg == pytest.approx(0.107)
    tube = parse_config("rig: {springs: {system_resonance_hz: 356, tube: {}}}")
    own, rest = tube.rig.springs.inertia().own_mode.mass_kg, tube.rig.moving_masses()
    model = AdoptedModel(
        "d.json", {}, (), {"m1": rest[0] - own, "m2": rest[1] - own, "k1": 5.4e5, "k2": 5.4e5, "mt": own}
    )
    assert with_model(tube, model).rig.masses.m1_kg == pytest.approx(0.107)
    assert with_model(tube, model).rig.moving_masses() == pytest.approx(rest)
