"""config.yaml: the shipped one, every kind of fault, and that what is said names key, value and what is allowed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mesotap.configuration.config import Config, ConfigError, default_text, effective_text, load_config, parse_config

ROOT = Path(__file__).parents[3]


def test_the_shipped_configuration_spells_out_the_defaults():
    shipped = load_config(ROOT / "config.yaml")
    defaults = Config()
    assert shipped.model_copy(update={"mesotap": defaults.mesotap}) == defaults
    assert shipped.mesotap.load_plan_mn == defaults.mesotap.load_plan_mn


def test_the_shipped_configuration_names_every_key():
    given_keys = yaml.safe_load(default_text())
    in_force = yaml.safe_load(effective_text(Config()))
    assert given_keys.keys() == in_force.keys()
    for section, keys in in_force.items():
        if section not in ("version", "rig", "analysis"):
            assert given_keys[section].keys() == keys.keys(), section


def test_the_former_name_of_the_simulated_stiffness_is_still_read():
    old = "sim_backend: {contact: {contact_stiffness_mn_per_m: [1, 2, 3, 4, 5, 6, 7, 8]}}"
    assert parse_config(old).sim_backend.contact.contact_stiffness_n_per_um == (1, 2, 3, 4, 5, 6, 7, 8)
    assert "stiffness_mn_per_m" not in effective_text(parse_config(old))
    with pytest.raises(ConfigError, match="former name of contact_stiffness_n_per_um"):
        parse_config(old.replace("8]", "8], contact_stiffness_n_per_um: [1, 2, 3, 4, 5, 6, 7, 8]"))


def test_mn_is_millinewton_in_every_key():
    def keys(content, before=""):
        for key, value in content.items():
            yield f"{before}{key}"
            if isinstance(value, dict):
                yield from keys(value, f"{before}{key}.")

    assert not [key for key in keys(yaml.safe_load(effective_text(Config()))) if "mn_per_m" in key]


def test_tube_springs_heavier_than_the_masses_are_refused():
    with pytest.raises(ConfigError, match="as much as the masses themselves"):
        parse_config("rig: {springs: {k1_n_per_m: 5.0e+5, k2_n_per_m: 5.0e+5, added_mass_kg: 0.2}}")


def test_what_is_in_force_reads_back_as_itself():
    config = parse_config("", changes=["mesotap.dwell_s=3", "analysis.contact=paper-sphere"])
    assert parse_config(effective_text(config)) == config


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("rig: {masses: {m1_kg: -1}}", ["rig.masses.m1_kg", "-1", "greater than 0"]),
        (
            "rig: {springs: {system_resonance_hz: 1.0e-300}}",
            ["rig.springs.system_resonance_hz: 1e-300 is smaller than"],
        ),
        ("rig: {springs: {system_resonance_hz: 1.0e+300}}", ["rig.springs.system_resonance_hz: 1e+300 is larger than"]),
        ("rig:\n  masses:\n    m1: 3", ["line 3", "rig.masses.m1", "m1_kg, m2_kg, uncertainty_kg"]),
        ("mesotap: {load_plan: [1]}", ["mesotap.load_plan", "did you mean load_plan_mn?"]),
        ("mesotap: {impacts_per_load: eight}", ["mesotap.impacts_per_load", "'eight'", "integer"]),
        ("mesotap: {load_plan_mn: []}", ["mesotap.load_plan_mn", "at least one load"]),
        ("mesotap: {load_plan_mn: [2000]}", ["2006 mN", "rig.limits.load_mn (1100)"]),
        ("rig: {springs: {k1_n_per_m: 5.0e+5}}", ["rig.springs", "system_resonance_hz", "k2_n_per_m"]),
        ("rig: {limits: {search_beyond_um: 100}}", ["search_beyond_um", "26893 mN", "limits.load_mn (1100)"]),
        ("rig: {wiring: {strain_gauge_input: 0}}", ["rig.wiring", "share one input"]),
        ("calibration: {weights_mn: [0, 100]}", ["calibration.weights_mn", "three different weights"]),
        ("analysis: {contact: gold}", ["analysis.contact", "'gold'", "paper-flat, paper-sphere"]),
        ("analysis: {contact: {geometry: sphere, radius: 3}}", ["analysis.contact.radius", "did you mean radius_um?"]),
        ("analysis: {method: magic}", ["analysis.method", "'magic'", "'ml' or 'era'"]),
        ("sim_backend: {contact: {load_mn: [3, 2]}}", ["sim_backend.contact", "one length"]),
        ("nonsense: 3", ["nonsense is not a known key", "allowed here: analysis, calibration, daq"]),
        ("daq: {trigger: {pretrigger_samples: 4000}}", ["pretrigger_samples", "less than half"]),
        ("rig: {masses: {m1_kg: .nan}}", ["rig.masses.m1_kg", "nan"]),
        ("- a\n- b", ["is not a configuration"]),
        ("rig: [1", ["line 1", "is not YAML"]),
        ("rig: 3", ["rig is 3"]),
    ],
)
def test_a_fault_is_one_sentence_that_names_it(text, expected):
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "my.yaml")
    sentence = str(caught.value)
    assert sentence.startswith("my.yaml")
    assert "\n" not in sentence
    for part in expected:
        assert part in sentence


def test_every_fault_has_its_line():
    with pytest.raises(ConfigError) as caught:
        parse_config("rig:\n  masses: {m1_kg: 0}\nmesotap:\n  dwell_s: -1\n", "my.yaml")
    assert [line.split(":")[0] for line in str(caught.value).splitlines()] == ["my.yaml, line 4", "my.yaml, line 2"]


@pytest.mark.parametrize(
    ("change", "expected"),
    [("dwell", "section.key=value"), ("mesotap.dwell_s.x=1", "dwell_s holds no further keys"), ("a.b=[", "not YAML")],
)
def test_a_wrong_change_says_what_to_write(change, expected):
    with pytest.raises(ConfigError, match=expected):
        parse_config("mesotap: {dwell_s: 3}", changes=[change])


@pytest.mark.parametrize("content", [b"\xff\xfe\x00bad", None])
def test_an_unreadable_file_is_named(tmp_path, content):
    path = tmp_path / "c.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"c\.yaml: (is not a text file|there is no such file)"):
        load_config(path)


def test_springs_from_the_system_resonance():
    k1, k2 = parse_config("rig: {springs: {system_resonance_hz: 356}}").rig.spring_stiffness()
    assert k1 == k2 == pytest.approx(0.5379e6, rel=1e-4)


@settings(max_examples=300, deadline=None)
@given(st.text(max_size=200))
def test_no_text_is_more_than_refused(text):
    try:
        parse_config(text)
    except ConfigError as refusal:
        assert str(refusal)


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
SECTIONS = ["mesotap", "rig", "daq", "calibration", "analysis", "sim_backend"]


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(st.sampled_from(SECTIONS), plain, max_size=3))
def test_no_structure_is_more_than_refused(content):
    try:
        parse_config(yaml.safe_dump(content))
    except ConfigError as refusal:
        assert str(refusal)


TRA12CC = "rig.parts.stage={driver: conex-cc, port: /dev/ttyUSB1, actuator: tra12cc}"


def test_a_tolerance_finer_than_the_stage_can_hold_is_refused_with_what_to_do():
    with pytest.raises(ConfigError, match=r"load_tolerance_mn of 6 cannot be held: .* 55\.4 mN .* give at least 28"):
        parse_config("", changes=[TRA12CC])
    parse_config("", changes=[TRA12CC, "mesotap.load_tolerance_mn=28"])
    soft = ["rig.springs={k1_n_per_m: 110000, k2_n_per_m: 110000}", "rig.limits={clearance_um: 110}"]
    parse_config("", changes=[TRA12CC, *soft])


def test_the_simulated_stage_is_not_held_to_what_is_sold():
    parse_config("", changes=["sim_backend.stage.resolution_um=0.2"])


def test_a_step_towards_contact_smaller_than_the_stages_is_refused():
    with pytest.raises(ConfigError, match=r"largest_approach_step_um of 0\.1 is less than a step of the stage, 0\.2"):
        parse_config("", changes=[TRA12CC, "mesotap.load_tolerance_mn=28", "rig.limits.largest_approach_step_um=0.1"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("rig:\n  limits:\n    load_mn: 1\n    load_mn: 2", "load_mn is given twice, in line 3 and in line 4"),
        ("rig: {}\nmesotap: {}\n'rig': {}", "rig is given twice, in line 1 and in line 3"),
        ("a: &a [*a]", "an alias stands inside of what it stands for"),
        ("x" * 100_001, "longer than 100 kB"),
    ],
)
def test_yaml_that_is_sound_and_not_taken(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        parse_config(text)


def test_a_key_given_twice_in_a_change_is_refused() -> None:
    with pytest.raises(ConfigError, match="dwell_s is given twice"):
        parse_config("", changes=["mesotap={dwell_s: 1, dwell_s: 2}"])


def test_an_alias_for_a_few_entries_is_taken() -> None:
    text = "rig: {masses: &masses {m1_kg: 0.1}}\nmesotap: {dwell_s: 1}\n"
    assert parse_config(text).rig.masses.m1_kg == 0.1
    both = "daq: {quality: &q {second_impact_ratio: 0.1}, trigger: {timeout_s: &t 12}}\nmesotap: {dwell_s: *t}"
    assert parse_config(both).mesotap.dwell_s == 12


def test_the_former_name_of_a_limit_is_understood() -> None:
    assert parse_config("daq: {quality: {second_blow_ratio: 0.1}}").daq.quality.second_impact_ratio == 0.1


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("load_mn", 1e29),
        ("largest_approach_step_um", 1e3),
        ("stale_reading_s", 60),
        ("frozen_readings", 10**6),
        ("contact_threshold_mn", 1e4),
        ("clearance_um", 1e9),
        ("largest_backlash_um", 1e4),
        ("expected_contact_um", 1e9),
    ],
)
def test_a_limit_beyond_reason_is_refused(key: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"rig.limits.{key} is .*less than or equal to"):
        parse_config("", changes=[f"rig.limits.{key}={value}"])


def test_what_is_in_force_holds_nothing_that_a_terminal_acts_on() -> None:
    config = parse_config("", changes=['mesotap.operator="\\e[31m\\u202e"'])
    text = effective_text(config)
    assert all(line.isprintable() for line in text.splitlines())
    assert parse_config(text) == config


STAGE = "rig.parts.stage={driver: conex-cc, port: /dev/ttyUSB1, resolution_um: 0.02}"


def test_two_devices_on_one_port_are_refused():
    gauge = "rig.parts.load_cell={driver: modbus-rtu, preset: seneca-ze-sg3, port: /dev/ttyUSB1}"
    with pytest.raises(ConfigError, match="are both on /dev/ttyUSB1"):
        parse_config("", changes=[STAGE, gauge])


def test_a_contact_beyond_the_travel_is_refused():
    with pytest.raises(ConfigError, match=r"is looked for up to 22\.003 mm of the stage"):
        parse_config("", changes=[STAGE, "rig.limits.expected_contact_um=20000"])


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("0600", "0600 is not written like a number: write 600"),
        ("00.5", "00.5 is not written like a number: write 0.5"),
        ("1:30", "1:30 is not written like a number"),
        ("0b11", "0b11 is not written like a number: write 3"),
        ("0x10", "0x10 is not written like a number: write 16"),
        ("1_000", "1_000 is not written like a number: write 1000"),
        ("'1_000'", "1_000 is not written like a number: write 1000"),
        ("2024-01-01", "2024-01-01 is not written like a number"),
        ("inf", "inf is not written like a number"),
        ("!!int 0600", "0600 is not written like a number: write 600"),
        ("!!float 1:30", "1:30 is not written like a number"),
        ("true", "true is not a number"),
        ("yes", "dwell_s is 'yes'"),
    ],
)
def test_what_could_be_mistaken_for_another_number_is_refused(written, said):
    with pytest.raises(ConfigError) as error:
        parse_config(f"mesotap:\n  dwell_s: {written}\n")
    assert "line 2" in str(error.value)
    assert said in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(("written", "value"), [("600", 600), ("6e2", 600), (".5", 0.5), ("+1.5e+2", 150), ("0", 0)])
def test_numbers_are_what_they_look_like(written, value):
    assert parse_config(f"mesotap: {{dwell_s: {written}}}").mesotap.dwell_s == value


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mesotap: {load_plan_mn: [0100]}", "mesotap.load_plan_mn.0: 0100 is not written like a number: write 100"),
        ("mesotap: {load_plan_mn: [true, 100]}", "mesotap.load_plan_mn.0: true is not a number"),
        ("rig: {filter: {highpass_order: true}}", "rig.filter.highpass_order: true is not a number"),
        ("rig: {wiring: {accelerometer_a: {input: 0, polarity: true}}}", "polarity: true is not a number"),
        ("mesotap: {diagnose: 1}", "mesotap.diagnose: 1 is neither true nor false"),
        ("mesotap: {diagnose: yes}", "mesotap.diagnose: 'yes' is neither true nor false"),
        ("mesotap: {diagnose: on}", "mesotap.diagnose: 'on' is neither true nor false"),
        ("mesotap: {diagnose: 'true'}", "mesotap.diagnose: 'true' is text: write true without quotes"),
        ("mesotap: {diagnose: !!bool yes}", "yes is neither true nor false"),
        ("mesotap: {title: 12}", "mesotap.title is 12: input should be a valid string, so write it in quotes"),
    ],
)
def test_numbers_truth_values_and_text_do_not_stand_for_each_other(text, said):
    with pytest.raises(ConfigError) as error:
        parse_config(text)
    assert said in str(error.value)


@pytest.mark.parametrize(
    "text", ["0600", "yes", "no", "1:30", "0x10", "1_000", "1e5", "1.5e5", "-.5", "2024-01-01", "01D2E3F4"]
)
def test_text_is_kept_as_it_is_written(text):
    config = parse_config(
        f"mesotap: {{title: {text}, load_tolerance_mn: 30}}\n"
        f"rig: {{parts: {{stage: {{driver: conex-cc, port: {text}, expected_identity: {text}}}}}}}"
    )
    assert config.mesotap.title == text
    assert config.rig.parts.stage.port == config.rig.parts.stage.expected_identity == text
    assert parse_config(effective_text(config)) == config


@pytest.mark.parametrize("serial", ["01D2E3F4", "00000600", "0600", "1E234567"])
def test_a_serial_number_is_text(serial):
    config = parse_config(f"rig: {{parts: {{accelerometers: {{driver: usb-1608fs-plus, serial_number: {serial}}}}}}}")
    assert config.rig.parts.accelerometers.serial_number == serial


def test_changes_on_the_command_line_are_read_alike():
    for change, said in (
        ("mesotap.dwell_s=0600", "--set: mesotap.dwell_s: 0600 is not written like a number: write 600"),
        ("mesotap.load_plan_mn=[0100]", "--set: mesotap.load_plan_mn.0: 0100 is not written like a number"),
        ("mesotap.diagnose=yes", "--set: mesotap.diagnose: 'yes' is neither true nor false"),
    ):
        with pytest.raises(ConfigError, match=re.escape(said)):
            parse_config("mesotap:\n  dwell_s: 5\n", "config.yaml", [change])


@pytest.mark.parametrize("end", ["\x85", "\u2028", "\u2029"])
def test_line_ends_that_no_editor_shows_are_refused(end):
    with pytest.raises(ConfigError, match=rf"line 2: holds the character U\+{ord(end):04X}"):
        parse_config(f"mesotap:\n  # dwell_s:{end}  dwell_s: 7\n")
    config = parse_config(f'mesotap: {{title: "a\\u{ord(end):04x}b"}}')
    assert config.mesotap.title == f"a{end}b"
    assert parse_config(effective_text(config)) == config


def test_without_a_hammer_a_configuration_reads_as_it_did_before_there_were_any():
    assert "hammer" not in effective_text(Config())
    with_one = parse_config("rig: {wiring: {hammer: {input: 3}}}")
    assert parse_config(effective_text(with_one)) == with_one


@pytest.mark.parametrize(
    ("hammer", "said"),
    [
        ("{}", "input"),
        ("{input: 2}", "share one input"),
        ("{input: 3, sensitivity_mv_per_n: 0}", "sensitivity_mv_per_n"),
        ("{input: 3, sensitivity_mv_per_lbf: 100}", "sensitivity_mv_per_lbf"),
        ("{input: 3, largest_force_n: -1}", "largest_force_n"),
    ],
)
def test_a_hammer_that_cannot_be_is_refused(hammer, said):
    with pytest.raises(ConfigError, match=said):
        parse_config(f"rig: {{wiring: {{hammer: {hammer}}}}}")


def test_more_good_taps_than_tries_are_refused():
    with pytest.raises(
        ConfigError, match=r"ask for 107 good taps at each load, and mesotap\.tries_per_load ends it after 40"
    ):
        parse_config("mesotap: {surplus_impacts: 99}\n")
    assert parse_config("mesotap: {surplus_impacts: 8}\n").mesotap.taps_per_load == 16
