"""Answers as other programs read them, held against the contract's schemas."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from analysis.mismatch.answer import Answer, Interval
from mesotap.answers.diagnosis_json import catalogue_sha256, diagnosis_json
from mesotap.answers.recording_files import recording_files
from tests.mesotap.answers.made import ANSWER, LEARNED, NAMED

CONTRACTS = Path(__file__).parents[2] / "contracts"
NOTHING = replace(
    ANSWER, verdict="consistent", mechanisms=(), location=None, rivals=(), next_experiment=None, fitted=None
)
UNBOUNDED = replace(
    ANSWER,
    mechanisms=(replace(NAMED, parameters={"x": Interval(1.0, -math.inf, math.nan, "N")}),),
    fit=replace(ANSWER.fit, heldout_rms_before=math.nan, heldout_rms_after=math.nan),
)
LEARNT = replace(ANSWER, verdict="new_physics", mechanisms=(LEARNED, NAMED))


def valid(answer: Answer, version: Any) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(json.dumps(diagnosis_json(answer, 1.5, version), allow_nan=False))
    schema = json.loads((CONTRACTS / f"diagnosis-{version}.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema).validate(content)
    return content


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("answer", [ANSWER, NOTHING, UNBOUNDED, LEARNT, replace(ANSWER, far_off=True)])
def test_every_answer_fits_the_contract(answer: Answer, version: int) -> None:
    valid(answer, version)


def test_version_2_says_times_in_s_and_loads_by_label() -> None:
    where = valid(ANSWER, 2)["location"]
    assert (where["time_s"], where["groups"]) == ([2e-4, 6.1e-3], ["104 mN"])


def test_version_1_says_times_in_ms_and_loads_in_mn() -> None:
    where = valid(ANSWER, 1)["location"]
    assert where["time_ms"] == pytest.approx([0.2, 6.1])
    assert where["loads_mn"] == pytest.approx([104.2])


def test_version_1_knows_no_learned_law() -> None:
    old = valid(LEARNT, 1)
    assert old["verdict"] == "missing_physics"
    assert [m["id"] for m in old["mechanisms"]] == [NAMED.id]


def test_version_1_calls_what_has_only_a_learned_law_unexplained() -> None:
    assert valid(replace(LEARNT, mechanisms=(LEARNED,)), 1)["verdict"] == "unexplained"


def test_version_1_is_for_the_tester_alone() -> None:
    with pytest.raises(ValueError, match="two-mass tester"):
        diagnosis_json(replace(ANSWER, rig="beam"), 1.0, 1)


def test_a_learned_law_is_written_whole() -> None:
    law = valid(LEARNT, 2)["mechanisms"][0]["law"]
    assert law["exponents"] == {"deflection": {"value": 3.0, "low": 2.9, "high": 3.1}, "rate": None}
    assert law["table"]["axes"]["deflection_m"] == [-1e-6, 0.0, 1e-6]


def test_the_catalogue_has_one_digest() -> None:
    assert len(catalogue_sha256()) == 64
    assert diagnosis_json(ANSWER, 1.0)["software"]["catalogue_sha256"] == catalogue_sha256()


def test_files_are_told_with_the_digest_of_their_content(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"1,2\n" * 1_000_000)
    (file,) = recording_files([path])
    assert (file.file, file.sha256) == (str(path), hashlib.sha256(path.read_bytes()).hexdigest())
