"""Whole diagnoses: the practice sessions, scatter between impacts, the shipped description given as a file."""

from __future__ import annotations

import functools
import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import yaml
from rich.console import Console
from scipy.stats import norm

from analysis.mismatch.answer import Answer
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.selection import screened_baseline
from daq.records import Session
from mesotap.answers.diagnosis_json import diagnosis_json
from mesotap.answers.recording_files import recording_files
from mesotap.commands.diagnose import Asked, diagnose
from mesotap.configuration.declared import header_uncertainty
from mesotap.configuration.rig_files import TESTER_FILE
from sim_backend.arrangement import tester as eq_9
from sim_backend.mechanisms.catalogue import catalogue, variants, without
from sim_backend.pulses import Pulse
from sim_backend.two_mass import TwoMass
from tests.analysis.practice import DATA, needs_data, practice, truth
from tests.analysis.ring_downs import RIG, diagnosed, exact, problem_of, session_of, with_law
from tests.analysis.terms import listed

KNOWN = [listed(name) for name in ("hertz_stiffness", "contact_creep", "tube_spring_damping")]
FEW = ("hunt_crossley_damping", "channel_gain", "hertz_stiffness", "quadratic_damping")
OTHERS = tuple(name for name in catalogue() if name not in FEW)  # what a test need not wait for
SHIPPED = files("mesotap.configuration").joinpath(TESTER_FILE).read_text(encoding="utf-8")


@functools.cache
def answer_of(case: str, *excluded: str) -> Answer:
    return diagnosed([practice(case)], variants(without(catalogue(), excluded)), learn=True).answer


@pytest.mark.slow
@pytest.mark.data
@needs_data
def test_nothing_is_found_where_nothing_is_hidden() -> None:
    assert answer_of("case-027").verdict == "consistent"


@pytest.mark.long
@pytest.mark.data
@needs_data
def test_hunt_crossley_damping_is_named_with_an_interval_that_holds_the_truth() -> None:
    found = answer_of("case-021").mechanisms
    growth = found[0].parameters["damping_growth_per_relative_approach"]
    true = truth("case-021")["effect"]["damping_growth_per_relative_approach"]
    assert [m.id for m in found] == ["hunt_crossley_damping"]
    assert growth.low < true < growth.high


@pytest.mark.long
@pytest.mark.data
@needs_data
def test_held_out_impacts_get_better_with_what_is_named() -> None:
    found = answer_of("case-040")
    assert [m.id for m in found.mechanisms] == ["channel_gain"]
    assert found.fit.heldout_rms_after is not None
    assert found.fit.heldout_rms_after < found.fit.heldout_rms_before


@pytest.mark.slow
@pytest.mark.data
@needs_data
def test_an_excluded_mechanism_is_not_replaced_by_a_certain_wrong_name() -> None:
    found = answer_of("case-030", "rocking")  # two others together leave nothing of it
    assert found.verdict != "consistent"
    assert all(m.probability < 0.9 for m in found.mechanisms)


@pytest.mark.slow
@pytest.mark.data
@needs_data
def test_the_answer_is_what_other_programs_read() -> None:
    found = replace(answer_of("case-027"), recordings=recording_files([DATA / "case-027.h5"]))
    answer = diagnosis_json(found, 1.0)
    assert (answer["format"], answer["version"], answer["verdict"]) == ("mesotap-diagnosis", 2, "consistent")
    assert json.loads(json.dumps(answer, allow_nan=False)) == answer


@pytest.mark.slow
def test_scatter_between_impacts_is_no_missing_physics() -> None:
    rng = np.random.default_rng(5)

    def record(rig: TwoMass, load_n: float, pulse: Pulse) -> np.ndarray:
        own = replace(rig, kc=rig.kc * (1 + 1e-3 * rng.standard_normal()))
        found = exact(own, load_n, pulse)
        return np.stack([found.acceleration, found.acceleration])

    session = session_of(record, ratios=(0.3, 0.3, 0.3, 0.3, 0.3, 0.3))
    problem = problem_of(session)
    assert screened_baseline(ImpactJudge.of(problem, KNOWN)).screening.p_value < problem.policy.level
    assert diagnosed([session], KNOWN).answer.verdict == "consistent"


def test_the_shipped_description_is_eq_9() -> None:
    values = {"m1": 0.107, "m2": 0.11, "k1": 4.6e5, "k2": 4.8e5, "kc": 7e6, "cc": 9.0}
    expected = eq_9(**values, mass_uncertainty=0.0, spring_uncertainty=0.0)
    for found, true in zip(RIG.arrangement.matrices(values), expected.matrices(values), strict=True):
        np.testing.assert_array_equal(found, true)
    for part in ("bodies", "masses", "elements", "sensors", "tapped", "inputs"):
        assert getattr(RIG.arrangement, part) == getattr(expected, part)


def written_out(session: Session) -> str:
    """The shipped description with the header's numbers and their uncertainties in the place of references to it."""
    described = yaml.safe_load(SHIPPED)
    uncertainty = header_uncertainty(session)
    constants = [*described["bodies"].values(), *(s["stiffness"] for s in described["springs"])]
    for said in constants:
        key = said.pop("header")
        said |= {"value": getattr(session.rig, key), "uncertainty": uncertainty[key]}
    text: str = yaml.safe_dump(described, sort_keys=False)
    return text


@pytest.mark.data
@pytest.mark.slow
@needs_data
@pytest.mark.parametrize("numbers", [False, True], ids=["references to the header", "numbers"])
@pytest.mark.parametrize("case", ["case-027", "case-021", "case-040"])
def test_a_description_in_a_file_gives_the_answer_of_the_built_in_one(case: str, numbers: bool, tmp_path: Path) -> None:
    expected = answer_of(case, *OTHERS)
    file, written = tmp_path / "rig.yaml", tmp_path / "answer.json"
    file.write_text(written_out(practice(case)) if numbers else SHIPPED, encoding="utf-8")
    diagnose([DATA / f"{case}.h5"], Asked(rig=file, json=written, without=OTHERS), Console(quiet=True))
    found = json.loads(written.read_text())
    assert found["verdict"] == expected.verdict
    assert [m["id"] for m in found["mechanisms"]] == [m.id for m in expected.mechanisms]
    for one, other in zip(found["mechanisms"], expected.mechanisms, strict=True):
        for name, interval in other.parameters.items():
            mine = one["parameters"][name]
            assert [mine[k] for k in ("value", "low", "high")] == pytest.approx(
                [interval.value, interval.low, interval.high], rel=1e-6
            )


def test_an_upper_limit_is_the_bound_of_the_score_in_the_parameters_unit() -> None:
    found = diagnosed([session_of(with_law(), noise=0.02)], [listed("channel_gain"), listed("guide_friction")])
    limits = {limit.id: limit for limit in found.answer.upper_limits}
    assert sorted(limits) == ["channel_gain", "guide_friction"]
    for name, limit in limits.items():
        score = next(s for s in found.selection.screening.scores if s.term.mechanism.id == name)
        size = score.strength if score.term.mechanism.one_signed else abs(score.strength)
        bound = (max(size, 0.0) + norm.ppf(0.95) * score.error) * abs(score.term.values[limit.parameter])
        assert limit.value == pytest.approx(bound)
        assert limit.probability == 0.95


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rough_surface_stiffness", "hertz_stiffness"])
def test_a_contact_tapped_with_nearly_all_of_its_load_is_named(name: str) -> None:
    """The score of a law in which nothing is free says little where the law is strong."""
    others = [listed(k) for k in ("hertz_stiffness", "contact_creep", "adhesion", "rough_surface_stiffness")]
    answer = diagnosed([session_of(with_law(name), ratios=(0.3, 0.6, 0.9))], others).answer
    assert [m.id for m in answer.mechanisms] == [name]
    assert answer.mechanisms[0].probability > 0.9
    assert answer.fit.heldout_rms_after is not None
    assert answer.fit.heldout_rms_after < 1.05 * answer.fit.noise_rms < 0.1 * answer.fit.heldout_rms_before


@pytest.mark.slow
def test_what_is_named_has_no_upper_limit() -> None:
    session = session_of(with_law(), noise=0.02)
    louder = np.array([[1.0], [1.02]])
    impacts = tuple(replace(s, acceleration=louder * s.acceleration) for s in session.impacts)
    found = diagnosed([replace(session, impacts=impacts)], [listed("channel_gain"), listed("guide_friction")]).answer
    assert [m.id for m in found.mechanisms] == ["channel_gain"]
    assert [limit.id for limit in found.upper_limits] == ["guide_friction"]
