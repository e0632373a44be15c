"""Configurations of older and newer versions."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mesotap.configuration.config import ConfigError, default_text, parse_config
from mesotap.configuration.settings import CONFIG_VERSION
from mesotap.configuration.versions import STEPS, migrated, migrated_soundly, version_of
from mesotap.configuration.yaml_text import parsed
from tests.mesotap.test_cli import mesotap, refused

OLD = """\
# bench 3

# the rig, weighed in May
rig:
  masses: {m1_kg: 0.1071}   # with its screws
  parts:
    stage: motor            # for now
daq:
  quality: {second_blow_ratio: 0.1, largest_rotation: 0.2}  # stricter
sim_backend:
  contact:
    contact_stiffness_mn_per_m: [1, 2, 3, 4, 5, 6, 7, 8]   # guessed
"""
NEW = """\
# bench 3

version: 2
# the rig, weighed in May
rig:
  masses: {m1_kg: 0.1071}   # with its screws
  parts:
    stage: simulated            # for now
daq:
  quality: {second_impact_ratio: 0.1, largest_rotation: 0.2}  # stricter
sim_backend:
  contact:
    contact_stiffness_n_per_um: [1, 2, 3, 4, 5, 6, 7, 8]   # guessed
"""


def test_there_is_a_step_to_each_version() -> None:
    assert sorted(STEPS) == list(range(2, CONFIG_VERSION + 1))
    assert version_of(default_text()) == CONFIG_VERSION
    assert parse_config("").version == CONFIG_VERSION


def test_the_text_is_kept_but_for_what_has_another_name() -> None:
    assert migrated_soundly(OLD, "my.yaml") == NEW
    assert migrated(NEW) == NEW


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", "version: 2\n"),
        ("{rig: {masses: {m1_kg: 0.2}}}\n", "{version: 2, rig: {masses: {m1_kg: 0.2}}}\n"),
        ("version: 1  # old\nrig: {}\n", "version: 2  # old\nrig: {}\n"),
        ("# all of it\nrig: {}\n", "# all of it\nversion: 2\nrig: {}\n"),
        ("---\nrig: {}\n", "---\nversion: 2\nrig: {}\n"),
        ("rig:\r\n  masses: {}\r\n", "version: 2\nrig:\r\n  masses: {}\r\n"),
        ("rig: {parts: {stage: 'motor'}}", "version: 2\nrig: {parts: {stage: simulated}}"),
    ],
)
def test_the_version_has_its_place(before: str, after: str) -> None:
    assert migrated(before) == after
    assert parsed(after)[1]["version"] == 2


@settings(max_examples=25)
@given(
    m1=st.floats(0.09, 0.11),
    operator=st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), max_size=20),
    comment=st.text(st.characters(codec="ascii", exclude_categories=("C",)), max_size=20),
    flow=st.booleans(),
)
def test_what_is_migrated_means_the_same(m1: float, operator: str, comment: str, flow: bool) -> None:
    masses = f"{{m1_kg: {m1!r}}}" if flow else f"\n    m1_kg: {m1!r}   # {comment}"
    rig = f"rig:\n  masses: {masses}\n  parts: {{stage: motor}}\n"
    text = f"mesotap: {{operator: {json.dumps(operator, ensure_ascii=False)}}} # {comment}\n{rig}"
    after = migrated_soundly(text, "my.yaml")
    assert after.count(f"# {comment}") == text.count(f"# {comment}")
    assert parse_config(after).rig.masses.m1_kg == m1


def test_a_newer_one_is_refused_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("rig: {}\nversion: 3\n")
    said = refused("config", "check", cwd=tmp_path)
    assert (
        "config.yaml, line 2: version: a newer mesotap wrote this (version 3), this one reads up to version 2" in said
    )
    assert "update mesotap" in said
    assert said == refused("config", "migrate", cwd=tmp_path)


@pytest.mark.parametrize("version", ["0", "two", "1.5", "[2]", "true"])
def test_what_is_no_version_is_refused(version: str) -> None:
    with pytest.raises(ConfigError, match="version"):
        parse_config(f"version: {version}")


def test_an_older_one_is_read_and_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(OLD)
    said = mesotap("config", "check", cwd=tmp_path).stdout
    assert "config.yaml: is of version 1, and read as that; 'mesotap config migrate config.yaml' writes it as" in said
    mesotap("config", "migrate", cwd=tmp_path)
    assert "migrate" not in mesotap("config", "check", cwd=tmp_path).stdout


def test_the_difference_is_shown_and_the_old_file_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "my.yaml"
    file.write_text(OLD)
    file.chmod(0o640)
    (tmp_path / "my.yaml.v1").write_text("another one")
    (tmp_path / "link.yaml").symlink_to("my.yaml")
    shown = mesotap("config", "migrate", "--dry-run", "link.yaml", cwd=tmp_path).stdout
    assert file.read_text() == OLD
    said = mesotap("config", "migrate", "link.yaml", "--json", "out.json", cwd=tmp_path).stdout
    assert said.startswith(shown)
    assert "-    stage: motor            # for now\n+    stage: simulated            # for now" in said
    assert file.read_text() == NEW
    assert (tmp_path / "my.yaml.v1").read_text() == "another one"
    assert (tmp_path / "my.yaml.v1.1").read_text() == OLD
    assert file.stat().st_mode & 0o777 == 0o640
    answer = json.loads((tmp_path / "out.json").read_text())
    assert (answer["from"], answer["to"], answer["written"]) == (1, 2, True)
    assert "is of version 2 already" in mesotap("config", "migrate", "my.yaml", cwd=tmp_path).stdout


def test_one_that_is_not_valid_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "my.yaml").write_text(OLD.replace("0.1071", "-1"))
    assert "rig.masses.m1_kg is -1" in refused("config", "migrate", "my.yaml", cwd=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["my.yaml"]
