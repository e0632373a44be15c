"""Scores of learned laws, of answers made by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mesotap.proof import law_scores, page, scores
from mesotap.proof.entries import Entry, entry_of
from mesotap.proof.page import Proof
from mesotap.proof.scored import scored

CUBIC = {
    "kind": "static",
    "elements": ["contact"],
    "components": [],
    "exponents": {"deflection": 3.0, "load": 0.0},
    "conservative": True,
    "same": [],
}
CURVED = {
    "kind": "sensor",
    "elements": ["A", "B"],
    "components": [],
    "exponents": {},
    "conservative": None,
    "same": ["sensor_curvature"],
}


def learned(kind: str, probability: float = 0.95, element: str | None = "contact", **powers: Any) -> dict[str, Any]:
    exponents = {k: None if v is None else {"value": sum(v) / 2, "low": v[0], "high": v[1]} for k, v in powers.items()}
    return {
        "id": "learned_law", "learned": True, "probability": probability, "where": "contact", "element": element,
        "parameters": {}, "indistinguishable_from": [],
        "law": {"kind": kind, "symmetry": "odd", "conservative": True, "exponents": exponents},
    }  # fmt: skip


def listed(name: str, probability: float = 0.95, element: str | None = None, where: str = "contact") -> dict[str, Any]:
    return {
        "id": name, "learned": False, "probability": probability, "where": where, "element": element,
        "parameters": {}, "indistinguishable_from": [], "law": None,
    }  # fmt: skip


def answered(
    verdict: str,
    *mechanisms: Any,
    d: float = 100.0,
    law: Any = CUBIC,
    effect: str = "contact_cubic",
    component: str = "contact",
    kind: str = "outside",
    after: float | None = 1.03,
    **location: Any,
) -> Entry:
    answer = {
        "version": 2, "verdict": verdict, "p_value": 0.0, "mechanisms": list(mechanisms),
        "location": {"component": component, **location} if verdict != "consistent" else None,
        "fit": {"heldout_rms_before": 2.0, "heldout_rms_after": after}, "seconds": 3.0,
    }  # fmt: skip
    truth = {"kinds": [effect], "components": [component], "d": d, "kind": kind, "knowing_rms": 1.0, "effect": {}}
    entry = entry_of("session", truth | {"laws": [law]} if kind == "outside" else truth, answer)
    assert entry is not None
    return entry


def reached(entries: list[Entry]) -> list[tuple[int, int]]:
    return [(g.reached.hits, g.reached.of) for g in law_scores.goals(entries)]


def test_law_that_is_right_reaches_every_goal() -> None:
    law = learned("static", deflection=(2.9, 3.1), rate=None, load=(-0.2, 0.1))
    assert reached([answered("new_physics", law)]) == [(1, 1)] * 5 + [(2, 2)]


def test_what_was_not_learned_is_no_law_of_the_right_kind() -> None:
    unexplained = answered("unexplained", after=1.5, element="contact")
    assert reached([unexplained]) == [(1, 1), (1, 1), (1, 1), (0, 1), (0, 1), (0, 0)]


def test_what_was_missed_is_located_nowhere() -> None:
    assert reached([answered("consistent", d=30.0)]) == [(1, 1), (0, 1), (0, 0), (0, 0), (0, 0), (0, 0)]


def test_wrong_kind_exponent_and_place_are_counted() -> None:
    law = learned("memory", element="lower tube spring", deflection=(1.9, 2.1))
    assert reached([answered("new_physics", law, after=1.06)]) == [(1, 1), (1, 1), (0, 1), (0, 1), (0, 1), (0, 1)]


def test_other_name_is_wrong_when_it_is_stated_with_confidence() -> None:
    sure = answered("missing_physics", listed("micro_slip", 0.95, "contact"))
    unsure = answered("missing_physics", listed("micro_slip", 0.85, "contact"))
    second = answered("new_physics", learned("static"), listed("micro_slip", 0.95))
    found = reached([sure, unsure, second])
    assert found[0] == (1, 3)
    assert found[1] == (1, 3)


def test_same_equations_under_a_listed_name_are_right() -> None:
    curved = answered(
        "missing_physics", listed("sensor_curvature", 0.97, None, "sensor chain"), law=CURVED, effect="curved_sensors",
        component="sensor chain", channels=["A"],
    )  # fmt: skip
    assert reached([curved])[:4] == [(1, 1)] * 4
    (line,) = law_scores.of_effects([curved])
    assert (line.effect, line.grade, line.named, line.otherwise, line.wrongly_stated) == (
        "curved_sensors",
        100.0,
        1,
        0,
        0,
    )


def test_channel_that_is_sound_is_the_wrong_place() -> None:
    law = {**CURVED, "elements": ["A"]}
    both = answered("unexplained", law=law, component="sensor chain", channels=["A", "B"])
    one = answered("unexplained", law=law, component="sensor chain", channels=["A"])
    neither = answered("unexplained", law=law, component="sensor chain")
    assert [law_scores.placed(e) for e in (both, one, neither)] == [False, True, True]


def test_channels_say_nothing_of_an_element() -> None:
    right = answered("unexplained", element="contact", channels=["A", "B"])
    wrong = answered("unexplained", element="guide", channels=["A", "B"])
    assert [law_scores.placed(e) for e in (right, wrong)] == [True, False]


def test_laws_of_nothing_are_told() -> None:
    entries = [
        answered("new_physics", learned("static"), kind="null"),
        answered("consistent", kind="null"),
        answered("new_physics", learned("rate"), kind="single", effect="adhesion"),
    ]
    false = law_scores.false_laws(entries)
    assert (false.of_nothing.hits, false.of_nothing.of) == (1, 2)
    assert (false.of_listed.hits, false.of_listed.of) == (1, 1)


@pytest.mark.parametrize("kind", ["excluded", "outside"])
def test_learned_law_is_no_name_where_none_is_right(kind: str) -> None:
    entry = answered("new_physics", learned("static"), kind=kind, effect="adhesion")
    line = next(g for g in scores.unlisted([entry], kind) if g.grade == 100.0)
    assert (line.unexplained.hits, line.confident_wrong.hits) == (1, 0)


def test_learned_law_is_wrong_where_nothing_is_hidden_in_its_component() -> None:
    here = answered("new_physics", learned("static"), kind="single", effect="adhesion")
    elsewhere = answered("new_physics", learned("static"), kind="single", effect="mains_hum", component="sensor chain")
    assert not scores.confidently_wrong(here)
    assert scores.confidently_wrong(elsewhere)


def test_the_page_has_a_line_for_every_effect_and_goal(tmp_path: Path) -> None:
    entries = (
        answered("new_physics", learned("static", deflection=(2.9, 3.1))),
        answered("unexplained", law=CURVED, effect="curved_sensors", component="sensor chain"),
    )
    text = page.write(Proof("Trial", "By hand.", entries, {}), tmp_path).read_text(encoding="utf-8")
    assert "## Laws that nobody listed" in text
    assert "| contact_cubic | 100 | 1 | 1 | 0 |" in text
    assert "| curved_sensors | sensor | sensor_curvature |" in text
    found = scored(entries, {})
    assert [g["goal"] for g in found["laws"]["goals"]] == [0.99, 0.9, 0.9, 0.8, 0.8, 0.9]
    assert "Laws that nobody listed" not in page.write(Proof("Trial", "By hand.", (), {}), tmp_path).read_text()
