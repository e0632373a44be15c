"""Texts that have broken readers of YAML: taken or refused in sentences like any other."""

from __future__ import annotations

from itertools import pairwise

import pytest

from tests.fuzz.configs import taken_or_refused

LAUGHS = "a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{name}: &{name} [{', '.join(['*' + before] * 9)}]\n" for before, name in pairwise("abcdefghi")
)


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [*a]",
        "mesotap: {operator: &a [*a]}",
        "a: &a {b: *a}",
        "&a [*a]",
        "? [1, 2]\n: 3",
        "? {a: b}\n: 3",
        "[" * 3000,
        "{a: " * 3000,
        "rig: " + "9" * 5000,
        "rig: {masses: {m1_kg: 0x" + "f" * 5000 + "}}",
        "rig: 1:" + "59:" * 400 + "0",
        f"{LAUGHS}mesotap: {{operator: *i}}",
        f"{LAUGHS}mesotap: {{load_plan_mn: *i}}",
        f"{LAUGHS}rig: *i",
        "mesotap: {operator: " + "9" * 5000 + "}",
        "mesotap: {load_plan_mn: [[" + "9" * 5000 + "]]}",
        "!!python/object:os.system {}",
        "rig: !!binary 'x'",
        "rig: !!timestamp 2001-99-99",
        "rig: 2001-99-99",
        "mesotap: !!set {a, b}",
        "mesotap: !!omap [a: 1]",
        "mesotap: {<<: 3}",
        "mesotap: {<<: [1]}",
        "\x00",
        "\ud800",
        "%YAML 3.0\n---\na: 1",
        "a: 1\n---\nb: 2",
        "\ufeffmesotap: {}",
        "1: 2",
        "null: 2",
        "mesotap: {1: 2, null: 3, 1.5: 4, 2020-01-01: 5}",
    ],
)
def test_what_has_broken_readers_of_yaml(text):
    taken_or_refused(text)
