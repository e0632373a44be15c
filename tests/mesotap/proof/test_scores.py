"""Scores of answers made by hand, whose score is known."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mesotap.proof import page, scores
from mesotap.proof.entries import Entry, entry_of
from mesotap.proof.page import Proof
from mesotap.proof.parameters import true_parameters
from mesotap.proof.scored import scored


def mechanism(name: str, probability: float, alike: tuple[str, ...] = (), **intervals: tuple[float, float]) -> Any:
    parameters = {k: {"value": sum(v) / 2, "low": v[0], "high": v[1], "unit": "1"} for k, v in intervals.items()}
    return {
        "id": name,
        "probability": probability,
        "where": "contact",
        "statement": "It is so.",
        "parameters": parameters,
        "indistinguishable_from": list(alike),
    }


def answered(
    hidden: list[str], d: float, p: float, *named: Any, kind: str = "", component: str = "contact", **truth: Any
) -> Entry:
    """An entry; the verdict follows from p and the names."""
    verdict = "missing_physics" if named else ("unexplained" if p < 0.01 else "consistent")
    answer = {
        "verdict": verdict,
        "p_value": p,
        "mechanisms": list(named),
        "location": {"component": component} if p < 0.01 else None,
        "fit": {"heldout_rms_before": 2.0, "heldout_rms_after": 1.01 if named else None},
        "seconds": 3.0,
    }
    told: dict[str, Any] = {"kinds": hidden, "d": d, "effect": {}, "knowing_rms": 1.0, **truth}
    if kind:
        told["kind"] = kind
    entry = entry_of("session", told, answer)
    assert entry is not None
    return entry


NULLS = [answered([], 0.0, (i + 0.5) / 50) for i in range(50)]


def test_false_alarms_are_counted_and_even_p_values_called_uniform() -> None:
    found = scores.nulls([*NULLS, answered(["adhesion"], 100.0, 0.0)])
    assert (found.alarms.hits, found.alarms.of) == (0, 50)
    assert found.uniform > 0.99
    shifted = [replace(e, p_value=e.p_value**3) for e in NULLS]
    assert scores.nulls(shifted).uniform < 1e-3
    assert scores.nulls(shifted).alarms.hits == 11


def test_test_that_knows_alarms_at_its_level_and_sees_what_is_strong() -> None:
    assert scores.power(0.0) == pytest.approx(0.01)
    assert scores.power(1e-6) == pytest.approx(0.01, rel=1e-3)
    # two-sided normal test at 1 %: half of the effects at its threshold of 2.5758 are seen
    assert scores.power(2.5758) == pytest.approx(0.5, abs=1e-3)
    assert scores.power(30.0) == pytest.approx(1.0)


def test_singles_are_scored_by_grade() -> None:
    entries = [
        answered(["adhesion"], 95.0, 0.0, mechanism("adhesion", 0.99)),
        answered(["adhesion"], 110.0, 0.0, mechanism("micro_slip", 0.95)),
        answered(["adhesion"], 90.0, 0.0, mechanism("micro_slip", 0.95, ("adhesion",))),
        answered(["guide_friction"], 100.0, 0.0),
        answered(["adhesion"], 3.0, 0.4),
    ]
    at = {g.grade: g for g in scores.by_grade(entries)}
    strong = at[100.0]
    assert (strong.detected.hits, strong.detected.of) == (4, 4)
    assert (strong.component.hits, strong.component.of) == (3, 4)
    assert strong.right.hits == 1
    assert strong.covered.hits == 2
    assert strong.confident_wrong.hits == 1
    assert strong.unexplained.hits == 1
    assert strong.false_sets.of == 0
    assert at[3.0].missed.hits == 1
    assert at[30.0].detected.of == 0


def test_declared_look_alike_that_is_none_is_found_out() -> None:
    entry = answered(["adhesion"], 90.0, 0.0, mechanism("micro_slip", 0.95, ("adhesion",)))
    lines = scores.by_grade([replace(entry, likeness=0.4), replace(entry, likeness=0.97)])
    count = next(g for g in lines if g.grade == 100.0).false_sets
    assert (count.hits, count.of) == (1, 2)


def test_where_no_name_is_right_only_unexplained_is() -> None:
    entries = [
        answered(["adhesion"], 100.0, 0.0, kind="excluded"),
        answered(["adhesion"], 100.0, 0.0, mechanism("micro_slip", 0.95), kind="excluded"),
        answered(["adhesion"], 100.0, 0.0, mechanism("micro_slip", 0.7), kind="excluded"),
        answered(["bilinear_spring"], 30.0, 0.5, kind="outside", components=["tube springs"]),
    ]
    excluded = next(g for g in scores.unlisted(entries, "excluded") if g.grade == 100.0)
    assert (excluded.unexplained.hits, excluded.confident_wrong.hits, excluded.unexplained.of) == (1, 1, 3)
    outside = next(g for g in scores.unlisted(entries, "outside") if g.grade == 30.0)
    assert outside.missed.hits == 1


def test_a_name_accounts_for_one_of_two_effects() -> None:
    both = ["adhesion", "guide_friction"]
    entries = [
        answered(both, 100.0, 0.0, mechanism("adhesion", 0.9), mechanism("guide_friction", 0.9)),
        answered(both, 100.0, 0.0, mechanism("adhesion", 0.9, ("guide_friction",))),
        answered(both, 100.0, 0.0, mechanism("adhesion", 0.9), mechanism("micro_slip", 0.95, ("guide_friction",))),
        answered(both, 100.0, 0.0, mechanism("adhesion", 0.9), mechanism("micro_slip", 0.95)),
        answered(both, 100.0, 0.0),
    ]
    found = scores.pairs(entries)
    assert (found.both.hits, found.one.hits, found.confident_wrong.hits, found.both.of) == (2, 4, 1, 5)


def test_intervals_are_held_against_the_truth() -> None:
    effect = {"friction_force_n": 0.2}
    said = [("guide_friction", (0.1, 0.3)), ("guide_friction", (0.3, 0.4)), ("micro_slip", (0.3, 0.4))]
    entries = [
        answered(["guide_friction"], 99.0, 0.0, mechanism(name, 1.0, friction_force_n=interval), effect=effect)
        for name, interval in said
    ]
    (line,) = scores.coverage(entries)
    assert (line.parameter, line.inside.hits, line.inside.of) == ("friction_force_n", 1, 2)
    assert scores.together([line, line]).of == 4


def test_calibration_tells_stated_from_true() -> None:
    right = answered(["adhesion"], 99.0, 0.0, mechanism("adhesion", 0.85))
    excluded = answered(["adhesion"], 99.0, 0.0, mechanism("micro_slip", 0.85, ("adhesion",)), kind="excluded")
    beside = answered(["adhesion"], 99.0, 0.0, mechanism("adhesion", 0.85), mechanism("micro_slip", 0.85))
    lines, brier = scores.calibration([right] * 7 + [beside, excluded] + NULLS)
    line = next(r for r in lines if r.right.of)
    assert (line.low, line.high) == (0.8, 0.9)
    assert line.mean == pytest.approx(0.85)
    assert line.right.share == pytest.approx(0.8)
    assert brier == pytest.approx(0.8 * 0.15**2 + 0.2 * 0.85**2)


def test_held_out_error_is_that_of_the_model_named() -> None:
    good = answered(["adhesion"], 99.0, 0.0, mechanism("adhesion", 0.85))
    null = replace(NULLS[30], heldout_rms=1.05)
    found = scores.held_out([good, null, answered(["adhesion"], 99.0, 0.0, mechanism("micro_slip", 0.85))])
    assert found.ratios == pytest.approx((1.01, 1.05))
    assert found.within.hits == 1


@given(st.integers(0, 40), st.integers(1, 40))
def test_intervals_of_shares_hold_the_share(hits: int, more: int) -> None:
    count = scores.Count(hits, hits + more)
    low, high = count.interval
    assert 0 <= low <= count.share <= high <= 1


@given(st.floats(1e-12, 1e6))
def test_every_d_has_a_grade(d: float) -> None:
    assert scores.grade(d) in scores.GRADES


def test_truths_are_turned_into_the_parameters_of_the_answers() -> None:
    truth = {
        "loads_n": [0.1, 1.0],
        "kc": [1e6, 4e6],
        "cc": [1.0, 2.0],
        "effect": {
            "slip_stiffness_n_per_m": [1e5, 4e5],
            "slip_force_n": [0.002, 0.02],
            "c1_n_s_per_m": 0.5,
            "c2_n_s_per_m": 0.5,
            "gain_of_b": 0.98,
            "quadratic_damping_n_s2_per_m2": [3.0, 9.0],
        },
    }
    slip = true_parameters(truth, "micro_slip")
    assert slip == pytest.approx({"slip_stiffness_share": 0.1, "slip_reach_share": 0.2})
    assert true_parameters(truth, "tube_spring_damping") == {"c_n_s_per_m": 0.5}
    assert true_parameters(truth, "channel_gain")["gain_error_of_b"] == pytest.approx(-0.02)
    # a ratio that differs from load to load is not a single number
    assert true_parameters(truth, "quadratic_damping") == {}
    assert true_parameters(truth, "hertz_stiffness") == {}


def test_base_strain_of_either_channel_is_what_b_shows_over_a() -> None:
    own, mass = -0.23, 0.108

    def of(channel: str) -> float:
        effect = {"base_strain_m_s2_per_n": own, "channel": channel}
        found = true_parameters({"effect": effect, "masses_kg": [0.107, mass]}, "base_strain")
        return found["base_strain_m_s2_per_n"]

    assert of("B") == own
    # near the contact resonance the contact's force is the lower mass's acceleration times its mass
    assert (1 + of("A") * mass) * (1 + own * mass) == pytest.approx(1.0)


def test_parameters_scored_are_those_that_the_program_reports() -> None:
    from mesotap.proof.parameters import _DERIVED, _SAME
    from sim_backend.mechanisms.catalogue import catalogue

    known = {name: family[0] for name, family in catalogue().items()}
    scored = [(m, p) for m, names in _SAME.items() for p in names] + [(m, p) for m, ps in _DERIVED.items() for p in ps]
    for name, parameter in scored:
        reported = {q.name for q in known[name].parameters} | {d.name for d in known[name].derived}
        assert parameter in reported, (name, parameter)


def test_page_tells_counts_and_failures(tmp_path: Path) -> None:
    entries = [*NULLS, answered(["adhesion"], 100.0, 0.0, mechanism("micro_slip", 0.97))]
    written = page.write(Proof("A proof", "From nowhere.", tuple(entries), {"session-9": "died | here"}), tmp_path)
    text = written.read_text(encoding="utf-8")
    assert "p below 0.01: 0 of 50" in text
    assert "| session-9 | died / here |" in text
    assert "| session | single | adhesion | 100 | missing_physics | 0 | micro_slip 0.97 |" in text
    for name in ("detection", "p-values", "reliability", "confusion"):
        assert (tmp_path / f"{name}.svg").stat().st_size > 1000
        assert f"({name}.svg)" in text
    found = json.loads((tmp_path / "scores.json").read_text(encoding="utf-8"))
    assert found["nulls"]["alarms"] == {
        "hits": 0,
        "of": 50,
        "share": 0.0,
        "interval": [0.0, pytest.approx(0.0711, abs=1e-3)],
    }
    assert found["calibration"][0]["mean"] is None


def test_empty_proof_has_a_page(tmp_path: Path) -> None:
    text = page.write(Proof("A proof", "From nowhere.", (), {}), tmp_path).read_text(encoding="utf-8")
    assert text.startswith("# A proof")
    assert math.isnan(scores.held_out([]).median)
    assert np.isnan(scores.nulls([]).uniform)


def limited(value: float, true: float, complete: float = 0.6, named: tuple[Any, ...] = ()) -> Entry:
    """A session with dry friction that is not named, its upper limit and its true force."""
    entry = answered(["guide_friction"], 3.0, 0.4, *named, kind="single", effect={"friction_force_n": true})
    return replace(entry, limits={"guide_friction": ("friction_force_n", value)}, complete=complete)


def test_an_upper_limit_holds_what_is_not_named_or_does_not() -> None:
    entries = [limited(2e-5, 1e-5), limited(2e-5, 1.9e-5), limited(2e-5, 3e-5), *NULLS]
    [(grade, count)] = scores.limits(entries)
    assert (grade, count.hits, count.of) == (3.0, 2, 3)


def test_completeness_is_that_the_names_are_what_is_hidden_and_no_others() -> None:
    alone = answered(["adhesion"], 100.0, 0.0, mechanism("adhesion", 0.9), kind="single")
    one_of_two = answered(["adhesion", "clipping"], 100.0, 0.0, mechanism("adhesion", 0.9), kind="two")
    assert [scores.complete(e) for e in (NULLS[0], alone, one_of_two)] == [True, True, False]


def test_the_page_tells_how_often_limits_hold_and_how_sure_completeness_is(tmp_path: Path) -> None:
    entries = (limited(2e-5, 1e-5), *(replace(e, complete=0.8) for e in NULLS))
    found = scored(entries, {})
    assert found["upper_limits"] == [{"grade": 3.0, "hits": 1, "of": 1}]
    # 50 nulls are complete and said to be so with 0.8, the hidden friction is not and was said to be with 0.6
    assert found["complete"]["brier"] == pytest.approx((50 * 0.2**2 + 0.6**2) / 51)
    assert "the limit holds" in page.write(Proof("Trial", "By hand.", entries, {}), tmp_path).read_text()
