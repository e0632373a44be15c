"""Learned laws that are kept: the file, its mechanism, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from analysis.mismatch.learning import is_learned
from analysis.mismatch.parameters import Term
from mesotap.answers.kept_law import listed_twin
from mesotap.cli import app
from sim_backend.learned.curves import begin_values
from sim_backend.learned.families import form_named
from sim_backend.learned.kept import kept_law
from sim_backend.mechanisms.catalogue import load_file
from sim_backend.mechanisms.conformance import benches, conformance
from sim_backend.mechanisms.kinds import AtRest, ForceLaw


def answer(family: str = "even_power", element: str = "contact", **exponents: float) -> dict[str, Any]:
    values = {
        "force_n": 0.0087, "reference_deflection_m": 1.8e-8, "reference_rate_m_per_s": 1.5e-4, "reference_load_n": 0.3,
        "deflection_exponent": 2.0, "rate_exponent": 0.0, "load_exponent": 0.0, **exponents,
    }  # fmt: skip
    formula = {
        "text": "0.0087 N * (d / 1.8e-08 m)**2", "evidence": 20.0, "family": family, "values": values,
        "parameters": {"force_n": {"value": 0.0087, "low": 0.0085, "high": 0.0089, "unit": "N"}},
    }  # fmt: skip
    where = "contact" if element == "contact" else "tube springs"
    law = {"kind": "static", "symmetry": "even", "conservative": True, "formulas": [formula]}
    learned = {"id": "learned_static", "learned": True, "where": where, "element": element, "law": law}
    return {
        "format": "mesotap-diagnosis", "version": 2, "rig": "two-mass tester", "verdict": "new_physics",
        "recordings": [{"file": "/elsewhere/session.h5", "sha256": "ab" * 32}], "software": {"mesotap": "0.1.0"},
        "mechanisms": [learned],
    }  # fmt: skip


def learn(folder: Path, content: Any, name: str = "my_law") -> tuple[int, str]:
    file = folder / "answer.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    result = CliRunner().invoke(app, ["learn", str(file), "--name", name, "-o", str(folder / "own")])
    return result.exit_code, result.output + ("" if result.exception is None else str(result.exception))


def test_a_learned_curve_is_kept_as_it_is(tmp_path: Path) -> None:
    key, content = "curve_of_deflection_7", answer()
    form = form_named(key)
    values = begin_values(form, (-1.8e-8, 1.8e-8), (-1.5e-4, 1.5e-4), 0.1, crowded=2.0)
    bends = {f"bend_{i + 1}": 0.01 * (i + 1) for i in range(7)}
    content["mechanisms"][0]["law"] |= {"formulas": [], "curve": key}
    content["mechanisms"][0] |= {
        "parameters": {k: {"value": v, "low": v, "high": v, "unit": "N"} for k, v in bends.items()},
        "fixed": {k: v for k, v in values.items() if k not in bends},
    }
    code, said = learn(tmp_path, content)
    assert code == 0, said
    (mechanism,) = load_file(tmp_path / "own" / "my_law.py")
    assert isinstance(mechanism, ForceLaw)
    assert not mechanism.parameters
    (trial,) = mechanism.trials(benches()[0].scale)
    learned, at = form.loaded, AtRest(0.3, 8e6, 5.0)
    assert isinstance(learned, ForceLaw)
    assert mechanism.packed(trial, at, 1e-5) == pytest.approx(learned.packed({**values, **bends}, at, 1e-5))
    assert not is_learned(Term(mechanism, trial, (2,)))


def test_a_kept_law_is_a_mechanism_that_conforms(tmp_path: Path) -> None:
    code, said = learn(tmp_path, answer())
    assert code == 0, said
    file = tmp_path / "own" / "my_law.py"
    (mechanism,) = load_file(file)
    assert mechanism.id == "my_law"
    assert [q.name for q in mechanism.parameters] == ["force_n"]
    assert isinstance(mechanism, ForceLaw)
    assert mechanism.fits == ("contact",)
    assert mechanism.preloaded
    trial = mechanism.trials(benches()[0].scale)[0]
    assert not is_learned(Term(mechanism, trial, (2,)))  # from now on it is a mechanism by its own name
    assert "session.h5" in file.read_text()
    assert "/elsewhere" not in file.read_text()
    assert [c for c in conformance(file) if not c.holds] == []


def test_a_kept_power_of_the_approach_needs_no_strength(tmp_path: Path) -> None:
    content = answer("power_of_approach", deflection_exponent=2.5)
    content["mechanisms"][0]["law"]["formulas"][0]["parameters"] = {
        "deflection_exponent": {"value": 2.502, "low": 2.497, "high": 2.507, "unit": "1"}
    }
    code, said = learn(tmp_path, content)
    assert code == 0, said
    file = tmp_path / "own" / "my_law.py"
    (mechanism,) = load_file(file)
    (exponent,) = mechanism.parameters
    assert (exponent.low, exponent.high) == pytest.approx((2.4945, 2.5095))
    assert [c for c in conformance(file) if not c.holds] == []


def test_what_turns_out_to_be_listed_is_not_written(tmp_path: Path) -> None:
    cubed = answer("odd_power", "tube springs", deflection_exponent=3.0)
    code, said = learn(tmp_path, cubed)
    assert code == 0
    assert "tube_spring_cubic" in said
    assert not (tmp_path / "own" / "my_law.py").exists()


def test_a_law_of_the_contact_is_none_of_the_listed_ones() -> None:
    law = kept_law(
        "my_law", "even_power", acts_in="contact", preloaded=True, component="contact",
        values=answer()["mechanisms"][0]["law"]["formulas"][0]["values"], free={"force_n": (0.0, 1.0)},
        learned_from={},
    )  # fmt: skip
    assert listed_twin(law) is None


def _without(key: str) -> dict[str, Any]:
    content = answer()
    del content["mechanisms"][0]["law"]["formulas"][0][key]
    return content


def _consistent() -> dict[str, Any]:
    return {**answer(), "verdict": "consistent", "mechanisms": []}


def _no_formula() -> dict[str, Any]:
    content = answer()
    content["mechanisms"][0]["law"]["formulas"] = []
    return content


@pytest.mark.parametrize(
    ("content", "name", "said"),
    [
        (_consistent(), "my_law", "no law was learned"),
        (_no_formula(), "my_law", "no formula"),
        (_without("family"), "my_law", "not a complete"),
        (answer("no_such_family"), "my_law", "not a complete"),
        (answer(force_n=float("nan")), "my_law", "not a"),
        ({**answer(), "version": 1}, "my_law", "which alone tells of learned laws"),
        ("{", "my_law", "is not JSON"),
        (answer(), "My Law", "a name has small letters"),
        (answer(), "hertz_stiffness", "is a mechanism's name already"),
        (answer(element="no such element"), "my_law", "has no element"),
    ],
)
def test_what_cannot_be_kept_gets_a_sentence(tmp_path: Path, content: Any, name: str, said: str) -> None:
    code, output = learn(tmp_path, content, name)
    assert code != 0
    assert said in output
    assert output.count("answer.json: ") <= 1  # one sentence, not one in another
    assert not (tmp_path / "own" / f"{name}.py").exists()


def test_a_learned_law_is_kept_before_it_is_adopted(tmp_path: Path) -> None:
    file = tmp_path / "answer.json"
    file.write_text(json.dumps(answer()))
    result = CliRunner().invoke(app, ["adopt", str(file), "-o", str(tmp_path / "twin.yaml")])
    assert result.exit_code != 0
    assert "mesotap learn" in str(result.exception)
    assert "not a complete" not in str(result.exception)
    assert not (tmp_path / "twin.yaml").exists()


def test_a_file_that_is_there_stays_as_it_is(tmp_path: Path) -> None:
    learn(tmp_path, answer())
    before = (tmp_path / "own" / "my_law.py").read_text()
    code, said = learn(tmp_path, answer(deflection_exponent=4.0))
    assert code != 0
    assert "exists already" in said
    assert (tmp_path / "own" / "my_law.py").read_text() == before
