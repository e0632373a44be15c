"""Questions to the catalogue: what they mean, which are refused, and that none can do harm."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mesotap.catalogue.question import KEYS, All, Is, Not, OneOf, QuestionError, Within, Words, asked, parsed, term
from mesotap.catalogue.store import Catalogue
from tests.mesotap.catalogue.lab import entry, kept, load


def test_terms_side_by_side_all_hold_and_or_binds_weaker():
    either = OneOf((All((Words(("operator",), "ann"), Is("verdict", "consistent"))), All((Is("drifted", True),))))
    assert parsed("operator:ann verdict:consistent or drifted:yes") == All((either,))


def test_a_minus_and_not_ask_for_the_opposite():
    assert parsed("-verdict:consistent") == parsed("not verdict:consistent") == All((Not(Is("verdict", "consistent")),))


@pytest.mark.parametrize(
    ("value", "low", "high"),
    [("300..500", 300.0, 500.0), ("300..", 300.0, math.inf), ("..500", -math.inf, 500.0), ("300", 299.5, 300.5)],
)
def test_a_range_has_one_end_or_two(value, low, high):
    found = term("load", value)
    assert isinstance(found, Within)
    assert found.low == pytest.approx(low, rel=1e-8)
    assert found.high == pytest.approx(high)


def test_units_are_those_that_people_write():
    assert term("kc", "5..9") == Within("kc", pytest.approx(5e6), pytest.approx(9e6))
    assert term("zeta", "0.1..2") == Within("zeta", pytest.approx(0.001), pytest.approx(0.02))


def test_until_a_day_includes_that_day():
    assert term("until", "2026-03-01").high == pytest.approx(term("since", "2026-03-02").low, abs=1e-3)
    assert term("until", "2026-03-01").high < term("since", "2026-03-02").low


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("load:abc", "takes a number or a range"),
        ("load:5..3", "ends before it begins"),
        ("load:..", "takes a number"),
        ("load:nan", "takes a number"),
        ("weather:fine", "nothing to ask for"),
        ("since:yesterday", "takes a date"),
        ("drifted:perhaps", "yes or no"),
        ("(load:3", "does not close"),
        ("load:3)", "never opened"),
        ('"worn', "does not close"),
        ("not", "needs something after it"),
        ("or worn", "both sides"),
        ("specimen:--", "needs a word"),
        ("(" * 60 + "a" + ")" * 60, "brackets within brackets"),
        ("-" * 60 + "a", "brackets within brackets"),
    ],
)
def test_what_is_no_question_is_refused_in_a_sentence(where, said):
    with pytest.raises(QuestionError, match=said) as refused:
        asked(where)
    assert "\n" not in str(refused.value)


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory):
    with Catalogue(tmp_path_factory.mktemp("index") / "c.sqlite") as made:
        made.put(
            kept(
                entry("a", load(0, 300.0, 4e6), load(1, 900.0, 10e6), specimen="17-4PH, ground", operator="Ann Müller"),
                entry("b", load(0, 310.0, 6e6, 0.03), specimen="brass", operator="Bo", verdict="consistent"),
                entry("c", specimen="17-4PH worn", title="steel", mechanism="contact_loss", verdict="missing_physics"),
            )
        )
        yield made


@pytest.mark.parametrize(
    ("where", "names"),
    [
        ("", "abc"),
        ("specimen:17-4PH", "ac"),
        ("specimen:17-4", "ac"),
        ("SPECIMEN:17-4ph -specimen:worn", "a"),
        ("operator:muller", "a"),
        ("material:steel", "c"),
        ("load:300..320 kc:5..", "b"),
        ("load:300..320 kc:9..", ""),
        ("(load:300..320) (kc:9..)", "a"),
        ("kc:5.. or mechanism:contact_loss", "abc"),
        ("zeta:2..4", "b"),
        ("-verdict:consistent", "ac"),
        ("-kc:5..", "c"),
        ("opens", "c"),
        ('"contact open"', "c"),
        ("state:damaged", ""),
    ],
)
def test_sessions_are_found(catalogue, where, names):
    assert sorted(e.name for e in catalogue.find(asked(where))) == sorted(names)


@settings(max_examples=60)
@given(
    st.text(max_size=80)
    | st.lists(st.sampled_from([*(f"{k}:" for k in KEYS), "(", ")", '"', "-", "or", "3..5", "*", "a"])).map("".join)
)
def test_any_text_finds_sessions_or_is_refused(catalogue, where):
    try:
        question = asked(where)
    except QuestionError:
        return
    assert {e.name for e in catalogue.find(question)} <= set("abc")
