"""Values of a configuration changed in its text, and nothing else."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mesotap.configuration.config import ConfigError, default_text, parse_config
from mesotap.configuration.edited import as_written, edited
from mesotap.console.settings_form import SettingsFile, comments_in, fields_of


def test_a_value_is_exchanged_and_comments_stay():
    text = "mesotap:   # session\n  dwell_s: 10.0  # rest\n  load_plan_mn: [1, 2]   # plan\n"
    after = edited(text, {("mesotap", "dwell_s"): "3", ("mesotap", "load_plan_mn"): "[300, 900]"})
    assert after == "mesotap:   # session\n  dwell_s: 3  # rest\n  load_plan_mn: [300, 900]   # plan\n"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "# only words\n",
        "rig: {}\n",
        "rig:\n",
        "rig: {limits: {load_mn: 1200}}\n",
        "rig:\n  limits:\n    load_mn: 1200\n",
    ],
)
def test_a_key_that_is_not_there_is_added(text):
    after = edited(text, {("rig", "limits", "stale_reading_s"): "0.25"})
    assert parse_config(after).rig.limits.stale_reading_s == 0.25
    assert ("1200" in text) == (parse_config(after).rig.limits.load_mn == 1200)


@given(st.text(min_size=0, max_size=60).filter(str.isprintable))
def test_any_text_of_one_line_is_kept_as_text(name):
    after = edited(
        "mesotap: {operator: x}  # who\n", {("mesotap", "operator"): f"'{name.replace(chr(39), chr(39) * 2)}'"}
    )
    assert parse_config(after).mesotap.operator == name
    assert after.endswith("# who\n")


@pytest.mark.parametrize("value", ["{a: 1}", "a: b", "1\n2", "[1, 2", "'open"])
def test_what_is_not_one_value_is_refused(value):
    with pytest.raises(ConfigError, match=r"mesotap\.dwell_s"):
        edited("mesotap: {dwell_s: 1}\n", {("mesotap", "dwell_s"): value})


@pytest.mark.parametrize("every", [10, pytest.param(1, marks=pytest.mark.slow)])
def test_every_field_of_the_defaults_can_be_set_to_itself(every):
    text = default_text()
    config = parse_config(text)
    fields = list(fields_of(config, text))
    assert len(fields) > 80
    fields = fields[::every]
    changes = {tuple(f["key"].split(".")): f["value"] or "''" for f in fields}
    after = edited(text, changes)
    assert parse_config(after) == config
    assert comments_in(text).items() <= comments_in(after).items()


def test_a_wrong_value_is_told_as_config_check_tells_it_and_not_saved(tmp_path):
    file = SettingsFile(tmp_path / "config.yaml")
    (tmp_path / "config.yaml").write_text("mesotap:\n  dwell_s: 1  # rest\n")
    form = file.form()
    outcome = file.save({"mesotap.dwell_s": "-3"}, form["state"])
    with pytest.raises(ConfigError) as fault:
        parse_config("mesotap:\n  dwell_s: -3  # rest\n", "config.yaml")
    assert outcome["faults"] == str(fault.value).split("\n")
    assert not outcome["saved"]
    assert (tmp_path / "config.yaml").read_text() == "mesotap:\n  dwell_s: 1  # rest\n"
    assert file.save({"mesotap.dwell_s": "3"}, form["state"])["saved"]
    assert (tmp_path / "config.yaml").read_text() == "mesotap:\n  dwell_s: 3  # rest\n"
    with pytest.raises(ConfigError, match="changed by somebody else"):
        file.save({"mesotap.dwell_s": "4"}, form["state"])


@pytest.mark.parametrize(
    "name",
    [
        "plate #7",
        "#7",
        "12",
        "17-4PH: ground",
        "Müller",
        "[a]",
        "{",
        "null",
        "yes",
        "'",
        '"',
        "- a",
        "&x",
        "*x",
        "Ü # b: c",
    ],
)
def test_a_name_that_a_person_types_is_a_name_whatever_it_would_be_in_yaml(tmp_path, name):
    file = SettingsFile(tmp_path / "config.yaml")
    (tmp_path / "config.yaml").write_text("mesotap: {specimen: before, dwell_s: 1}  # kept\n", encoding="utf-8")
    assert file.save({"mesotap.specimen": name}, file.form()["state"])["saved"]
    text = (tmp_path / "config.yaml").read_text(encoding="utf-8")
    assert parse_config(text).mesotap.specimen == name
    assert ("\\x" in text, text.endswith("# kept\n")) == (False, True)
    (shown,) = [f["value"] for f in file.form()["fields"] if f["key"] == "mesotap.specimen"]
    assert shown == name


@given(st.text(max_size=40).filter(str.isprintable))
def test_any_printable_name_is_written_as_it_is(name):
    after = edited("mesotap: {specimen: before}\n", {("mesotap", "specimen"): as_written(name)})
    assert parse_config(after).mesotap.specimen == name
