"""Whatever stands in config.yaml, it is taken or refused in sentences."""

from __future__ import annotations

from itertools import pairwise

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mesotap.config import Config, ConfigError, default_text, effective_text, load_config, parse_config
from tests.fuzz.mutations import Damage, damaged, damages, fuzzed

DEFAULT = default_text()

scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from(
        [0, 1, -1, 1e-300, 1e300, 10**400, "", "simulated", "hand", "motor", "usb-1608fs-plus", "1e5", "[]"]
    ),
    st.text(max_size=12),
    st.dates(),
    st.binary(max_size=4),
)
values = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.one_of(st.text(max_size=6), scalars), inner, max_size=3)
    ),
    max_leaves=6,
)


def _places(node: object, path: tuple = ()) -> list[tuple]:
    """Every key in the default configuration."""
    if not isinstance(node, dict):
        return [path]
    return [path, *(place for key, inner in node.items() for place in _places(inner, (*path, key)))]


WHOLE = yaml.safe_load(effective_text(parse_config(DEFAULT)))
PLACES = _places(WHOLE)[1:]


def taken_or_refused(text: str, changes: tuple[str, ...] = ()) -> None:
    try:
        config = parse_config(text, "some.yaml", changes)
    except ConfigError as error:
        assert str(error)
        for line in str(error).splitlines():
            assert line.startswith(("some.yaml", "--set")), line
            assert len(line) < 2000
        return
    assert isinstance(config, Config)
    assert parse_config(effective_text(config)) == config


def put(whole: object, place: tuple, value: object) -> object:
    """The configuration with another value at one place."""
    if not place or not isinstance(whole, dict):
        return value
    return {**whole, place[0]: put(whole.get(place[0], {}), place[1:], value)}


@given(st.text(max_size=200))
@fuzzed
def test_any_text(text):
    taken_or_refused(text)


@given(damages(8))
@fuzzed
def test_a_damaged_configuration(damage: Damage):
    taken_or_refused(damaged(DEFAULT.encode(), damage).decode("utf-8", "replace"))


@given(st.lists(st.tuples(st.sampled_from(PLACES), values), min_size=1, max_size=3))
@fuzzed
def test_any_value_at_any_key(edits):
    whole = WHOLE
    for place, value in edits:
        whole = put(whole, place, value)
    try:
        text = yaml.safe_dump(whole, allow_unicode=True)
    except (yaml.YAMLError, TypeError, ValueError):  # keys that cannot be sorted, or integers too long to print
        return
    taken_or_refused(text)


@given(st.one_of(st.text(max_size=30), st.tuples(st.sampled_from(PLACES), st.text(max_size=20))))
@fuzzed
def test_any_setting_on_the_command_line(change):
    text = change if isinstance(change, str) else f"{'.'.join(change[0])}={change[1]}"
    taken_or_refused("", (text,))


@given(st.one_of(st.binary(max_size=80), damages(3).map(lambda damage: damaged(DEFAULT.encode(), damage))))
@fuzzed
def test_any_bytes_in_the_file(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "some.yaml"
    path.write_bytes(content)
    try:
        load_config(path)
    except ConfigError as error:
        assert str(path) in str(error)


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
