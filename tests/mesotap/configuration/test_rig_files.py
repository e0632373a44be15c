"""Rig files: what they may say, and what is said of those that cannot be used."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from analysis.mismatch.diagnosis import diagnose_recordings
from analysis.session import AnalysisError
from daq.exchange import Recording
from daq.exchange.units import is_known_unit
from mesotap.cli import app
from mesotap.configuration import rig_files
from mesotap.configuration.config import ConfigError
from mesotap.configuration.rig_files import load_rig, parse_rig
from sim_backend.mechanisms.catalogue import catalogue

SENSOR = "sensors: [{channel: 0, of: m, shows: displacement}]\n"
SPRING = "springs: [{between: [m, ground]}]\n"
DOCS = Path(__file__).parents[3] / "docs" / "rigs"


@pytest.mark.parametrize("name", [f.name for f in sorted(DOCS.glob("*.yaml"))])
def test_examples_can_be_read(name):
    assert load_rig(DOCS / name).arrangement.elements


def test_defaults_are_what_the_documents_say():
    rig = parse_rig("bodies: {m: 2}\n" + SPRING + "joints: [{between: [m, ground]}]\n" + SENSOR)
    spring, joint = rig.arrangement.elements
    assert (spring.role, spring.damping) == ("spring", None)
    assert (joint.role, joint.damping) == ("joint", "damping of joint")
    constants = {p.name: p for p in rig.arrangement.parameters}
    assert math.isnan(constants["stiffness of spring"].value)
    assert constants["mass of m"].uncertainty == 0.0
    assert constants["gain of sensor 1"].value == 1.0
    assert math.isinf(constants["offset of sensor 1"].uncertainty)


def test_a_constant_with_an_uncertainty_is_held_by_it():
    rig = parse_rig(
        "bodies: {m: 2}\nsprings: [{between: [m, ground], stiffness: {value: 5, uncertainty: 0.1}}]\n" + SENSOR
    )
    k = next(p for p in rig.arrangement.parameters if p.unit == "N/m")
    assert (k.value, k.uncertainty) == (5.0, 0.1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is not a rig"),
        ("a: [", "line 1: is not YAML"),
        ("bodies: {m: 1}\n" + SENSOR, "nothing holds the bodies"),
        ("bodies: {m: heavy}\n" + SPRING + SENSOR, "line 1: bodies.m is 'heavy'"),
        ("bodies: {m: 0}\n" + SPRING + SENSOR, "bodies.m: a mass must be above 0"),
        ("bodies: {m: 1, n: 2}\n" + SPRING + SENSOR, "line 1: bodies.n: nothing holds, pushes or shows it"),
        ("bodies: {m: 1, n: 2}\n" + SPRING + SENSOR + "tapped: n", "line 1: bodies.n: nothing connects it"),
        (
            "bodies: {m: 1, n: 2, p: 3}\njoints: [{between: [n, p]}]\n" + SPRING + SENSOR,
            "rig.yaml, line 1: bodies.n, p: nothing connects them to the others",
        ),
        (
            "bodies: {m: 1}\n" + SPRING + "sensors: [{channel: 0, of: m, shows: velocity, unit: furlongs}]\n",
            "line 3: sensors.0.unit: 'furlongs' is no known unit",
        ),
        (
            "bodies: {m: 1}\n" + SPRING + "sensors: [{channel: 0, of: m, shows: displacement, unit: g}]\n",
            "its unit g is one of acceleration; write 'shows: acceleration'",
        ),
        ("bodies: {m: 1}\n" + SPRING + SENSOR + "units: {length: parsecs}", "units.length: 'parsecs' is no known unit"),
        ("bodies: {m: unknown}\n" + SPRING + SENSOR, "at least one body's mass"),
        ("bodies: {ground: 1}\n" + SPRING + SENSOR, "ground is what does not move"),
        (
            "bodies:\n  m: 1\n  far: 2\n  far away: 3\n" + SPRING + "joints:\n- {between: [m, far]}\n" + SENSOR,
            "rig.yaml, line 4: bodies.far away: nothing holds, pushes or shows it",
        ),
        ("bodies: {m: 1}\nsprings: [{between: [x, ground]}]\n" + SENSOR, "line 2: springs.0 names 'x'"),
        ("bodies: {m: 1}\nsprings: [{between: [m, m]}]\n" + SENSOR, "between m and itself"),
        ("bodies: {m: 1}\nsprings: [{between: [m, ground], stifness: 1}]\n" + SENSOR, "did you mean stiffness"),
        ("bodies: {m: 1}\n" + SPRING, "sensors is missing"),
        ("name: null\nbodies: {m: 1}\n" + SPRING + SENSOR, "line 1: name is empty"),
        ("bodies: {m: 1}\n" + SPRING + "sensors: [{channel: 0, of: m, shows: jerk}]\n", "sensors.0.shows is 'jerk'"),
        ("bodies: {m: 1}\n" + SPRING + "inputs: [{channel: 0}]\n" + SENSOR, "force_on"),
        (
            "bodies: {m: 1}\n" + SPRING + SENSOR + "inputs: [{channel: 0, force_on: m}]\nrecording: {band_hz: [1, 2]}",
            "without a measured input",
        ),
        ("bodies: {m: 1}\n" + SPRING + "recording: {band_hz: [9, 2]}\n" + SENSOR, "two rising frequencies"),
        ("bodies: {m: 1}\n" + SPRING + SENSOR + "tapped: x", "tapped names 'x', which is not a body; bodies are m"),
        ("bodies: {m: 1}\n" + SPRING + SENSOR + "tapped: ground", "tapped names 'ground', which is not a body"),
        ("bodies: {m: 1}\n" + SPRING + SENSOR + "tapped: [m]", "line 4: tapped is ['m']"),
        (
            "bodies: {m: {value: 1, uncertainty: 0.1, symbol: a}}\n"
            "springs: [{between: [m, ground], stiffness: {per: load, symbol: a}}]\n" + SENSOR,
            "the symbol 'a' stands for two constants",
        ),
        (
            "bodies: {m: 1, n: 1}\ncontacts:\n"
            "  [{between: [m, ground], preload: 1}, {between: [n, m], preload: 2}]\n" + SENSOR,
            "contacts are pressed together by different preloads",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_said_in_a_sentence(text, said):
    with pytest.raises(ConfigError) as error:
        parse_rig(text)
    assert said in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_a_constant_of_the_header_has_its_symbol_and_the_headers_name() -> None:
    rig = parse_rig("bodies: {m: {header: m1_kg, symbol: m1}}\n" + SPRING + SENSOR)
    assert rig.arrangement.masses == ("m1",)
    assert rig.header == {"m1": "m1_kg"}


def test_a_constant_of_each_load_has_its_scope() -> None:
    rig = parse_rig("bodies: {m: 1}\nsprings: [{between: [m, ground], stiffness: {per: load, symbol: k}}]\n" + SENSOR)
    assert [p.name for p in rig.arrangement.parameters if p.scope == "load"] == ["k"]


@pytest.mark.parametrize(("said", "force"), [("0.4", 0.4), ("load", 0.0)])
def test_a_preload_is_a_force_or_what_the_session_says(said: str, force: float) -> None:
    rig = parse_rig(f"bodies: {{m: 1}}\ncontacts: [{{between: [m, ground], preload: {said}}}]\n" + SENSOR)
    assert rig.arrangement.elements[0].preload
    assert rig.preload_n == force


def test_springs_that_are_alike_share_a_place() -> None:
    rig = parse_rig(
        "bodies: {m: 1, n: 1}\nsprings: [{between: [m, ground], alike: feet}, {between: [n, ground], alike: feet}]\n"
        + SENSOR
    )
    assert catalogue()["tube_spring_cubic"][0].places(rig.arrangement) == [(0, 1)]


@pytest.mark.parametrize(("said", "struck"), [("", "m"), ("tapped: n\n", "n")])
def test_the_first_body_is_tapped_unless_another_is_named(said: str, struck: str) -> None:
    held = "springs: [{between: [m, ground]}, {between: [n, ground]}]\n"
    assert parse_rig("bodies: {m: 1, n: 1}\n" + held + SENSOR + said).arrangement.tapped == struck


def test_the_shipped_tester_is_eq_9() -> None:
    m1, m2, k1, k2, kc, cc = 0.107, 0.108, 4.6e5, 4.7e5, 8e6, 5.0
    shipped = rig_files.tester_rig().arrangement
    mass, damping, stiffness = shipped.matrices({"m1": m1, "m2": m2, "k1": k1, "k2": k2, "kc": kc, "cc": cc})
    assert mass.tolist() == [m1, m2]
    assert damping.tolist() == [[cc, -cc], [-cc, cc]]
    assert stiffness.tolist() == [[k1 + kc, -kc], [-kc, k2 + kc]]


def test_a_rig_that_takes_its_constants_from_a_session_refuses_a_recording() -> None:
    t = np.arange(2000) / 1000
    recording = Recording(np.exp(-t) * np.sin([40 * t, 90 * t]), 1000.0, ("a", "b"), "", "ring.csv")
    with pytest.raises(AnalysisError, match=r"ring\.csv: is not a session, and two-mass tester takes from one its m1"):
        diagnose_recordings([recording], rig_files.tester_rig(), [])


def test_a_preload_that_only_a_session_tells_refuses_a_recording() -> None:
    t = np.arange(2000) / 1000
    recording = Recording(np.exp(-t)[None] * np.sin(90 * t), 1000.0, ("a",), "", "ring.csv")
    rig = parse_rig("bodies: {m: 1}\ncontacts: [{between: [m, ground], preload: load}]\n" + SENSOR)
    with pytest.raises(AnalysisError, match=r"ring\.csv: .* takes from one its preload of contact"):
        diagnose_recordings([recording], rig, [])


@settings(max_examples=150, deadline=None)
@given(st.text(max_size=200))
def test_any_text_is_a_rig_or_refused(text):
    try:
        parse_rig(text)
    except ConfigError as error:
        assert str(error)


TREES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=8) | st.integers(-5, 5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(["bodies", "springs", "inputs", "sensors", "recording", "units", "sweeps"]), TREES)
def test_any_value_of_a_section_is_accepted_or_refused(section, value):
    import yaml

    whole = {
        "bodies": {"m": 1},
        "springs": [{"between": ["m", "ground"]}],
        "sensors": [{"channel": 0, "of": "m", "shows": "velocity"}],
    } | {section: value}
    try:
        parse_rig(yaml.safe_dump(whole, allow_unicode=True))
    except ConfigError as error:
        assert str(error)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("bodies: {m: 010}", "line 1: bodies.m: 010 is not written like a number: write 10"),
        ("bodies: {m: 1:30}", "line 1: bodies.m: 1:30 is not written like a number"),
        ("bodies: {m: true}", "line 1: bodies.m: true is not a number"),
        ("bodies: {m: {value: 010, uncertainty: 1}}", "bodies.m.value: 010 is not written like a number: write 10"),
        ("bodies: {m: 1.0e+300}", "bodies.m: 1e+300 is larger than 1e+20"),
        ("bodies: {m: 1.0e-300}", "bodies.m: 1e-300 is smaller than 1e-20"),
        ("springs: [{between: [m, ground], stiffness: 0}]", "springs.0.stiffness: 0 holds nothing"),
        ("springs: [{between: [m, ground], stiffness: -5.0}]", "springs.0.stiffness: -5 holds nothing"),
        ("springs: [{between: [m, ground], stiffness: {value: -5, uncertainty: 1}}]", "stiffness: -5 holds nothing"),
        ("springs: [{between: [m, ground], stiffness: 1.0e+300}]", "springs.0.stiffness: 1e+300 is larger than"),
        ("springs: [{between: [m, ground], damping: -1}]", "springs.0.damping: -1 would drive the rig"),
        ("bodies: {m: {header: m3_kg}}", "bodies.m.header is 'm3_kg': input should be 'm1_kg', 'm2_kg'"),
        (
            "bodies: {m: {header: m1_kg, value: 1}}",
            "bodies.m.value is 1: is not a known key; allowed here: header, symbol",
        ),
        ("bodies: {m: {header: m1_kg, symbol: 5}}", "bodies.m.symbol is 5: input should be a valid string"),
        ("bodies: {m: {value: 1, uncertainty: 1, symbol: [a]}}", "bodies.m.symbol is ['a']"),
        ("bodies: {m: {value: 1}}", "bodies.m.uncertainty is missing"),
        ("springs: [{between: [m, ground], stiffness: {per: tap}}]", "stiffness.per is 'tap': input should be 'load'"),
        ("springs: [{between: [m, ground], damping: {per: tap}}]", "damping.per is 'tap': input should be 'load'"),
        (
            "springs: [{between: [m, ground], stiffness: {per: load, value: 3}}]",
            "value is 3: is not a known key; allowed",
        ),
        ("springs: [{between: [m, ground], stiffness: none}]", "stiffness is 'none': is not a number"),
        ("springs: [{between: [m, ground], alike: [a]}]", "springs.0.alike is ['a']: input should be a valid string"),
        ("springs: [{between: [m, ground], preload: 1}]", "springs.0.preload is not a known key"),
        (
            "contacts: [{between: [m, ground], preload: heavy}]",
            "preload is 'heavy': is not a force above 0 N, nor 'load'",
        ),
        ("contacts: [{between: [m, ground], preload: -1}]", "contacts.0.preload is -1: input should be greater than 0"),
        ("contacts: [{between: [m, ground], preload: 01}]", "contacts.0.preload: 01 is not written like a number"),
        ("sensors: [{channel: 0, of: m, shows: velocity, gain: 0.0}]", "sensors.0.gain: with a gain of 0"),
        ("sensors: [{channel: 0, of: m, shows: velocity, gain: -1.0e+200}]", "sensors.0.gain: -1e+200 is larger than"),
        ("sensors: [{channel: 0, of: {m: 0}, shows: velocity}]", "sensors.0.of: no body has a share"),
        ("sensors: [{channel: 0, of: {}, shows: velocity}]", "sensors.0.of: no body has a share"),
        ("sensors: [{channel: 0, of: {m: 01}, shows: velocity}]", "sensors.0.of.m: 01 is not written like a number"),
        ("sensors: [{channel: true, of: m, shows: velocity}]", "sensors.0.channel is True: names a column"),
        ("recording: {held_out: [{name: x, from_s: 2, to_s: .nan}]}", "held_out.0: to_s (nan) must lie after from_s"),
        ("recording: {held_out: [{name: x, from_s: 2, to_s: 1}]}", "held_out.0: to_s (1) must lie after from_s (2)"),
        ("recording: {from_s: 2, to_s: 1}", "recording: to_s (1) must lie after from_s (2)"),
        ("recording: {band_hz: [1.0e-300, 2]}", "recording.band_hz.0: 1e-300 is smaller than"),
    ],
)
def test_a_constant_that_no_rig_has_is_refused_with_its_key_and_line(line, said):
    key = line.partition(":")[0]
    text = {"bodies": "bodies: {m: 1}\n", "springs": SPRING, "sensors": SENSOR} | {key: line + "\n"}
    with pytest.raises(ConfigError, match="line ") as error:
        parse_rig("".join(text.values()))
    assert said in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_a_column_may_have_a_number_for_its_name():
    for written, channel in (("010", "010"), ("1", 1), ("'1'", "1"), ("yes", "yes")):
        assert parse_rig("bodies: {m: 1}\n" + SPRING + SENSOR.replace("0", written)).seen[0].channel == channel


@pytest.mark.parametrize(
    "line",
    [
        "springs: [{between: [m, ground], stiffness: 1.0e+20}]",
        "dampers: [{between: [m, ground], damping: 0}]",
        "recording: {band_hz: [1.0e-9, 2.0e-9]}",
    ],
)
def test_constants_far_from_the_recording_are_an_error_in_a_sentence(line):
    key = line.partition(":")[0]
    text = {"bodies": "bodies: {m: 1}\n", "springs": SPRING, "sensors": SENSOR} | {key: line + "\n"}
    if key == "dampers":
        del text["springs"]
    t = np.arange(2000) / 1000
    recording = Recording(np.array([np.exp(-t) * np.sin(2 * math.pi * 20 * t)]), 1000.0, ("a",), "", "ring.csv")
    with pytest.raises(AnalysisError, match=r"ring\.csv: ") as error:
        diagnose_recordings([recording], parse_rig("".join(text.values())), [])
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.slow
def test_a_rig_that_is_far_off_is_told_so_and_not_by_its_p_value(tmp_path):
    t = np.arange(2000) / 1000
    decay = np.exp(-1.5 * t) * np.sin(2 * math.pi * 20 * t) + 1e-4 * np.random.default_rng(0).normal(size=t.size)
    recording, rig = tmp_path / "ring.csv", tmp_path / "rig.yaml"
    recording.write_text("t,a\n" + "\n".join(f"{a},{b}" for a, b in zip(t, decay, strict=True)))
    rig.write_text("bodies: {m: 1}\nsprings: [{between: [m, ground], stiffness: 15.79}]\n" + SENSOR)
    answer = tmp_path / "answer.json"
    result = CliRunner().invoke(app, ["diagnose", str(recording), "--rig", str(rig), "--json", str(answer)])
    assert result.exit_code == 0
    said = " ".join(result.output.split())
    assert "misses most of the motion" in said
    assert "check its stiffness and mass" in said
    assert "p = " not in said
    found = json.loads(answer.read_text())
    assert (found["verdict"], found["fit"]["far_off"]) == ("unexplained", True)


def test_the_command_refuses_in_one_sentence_with_exit_code_2(tmp_path, monkeypatch):
    import sys

    from mesotap.__main__ import main

    rig, recording = tmp_path / "rig.yaml", tmp_path / "r.csv"
    rig.write_text("bodies: {m: 1}\n" + SPRING + SENSOR)
    recording.write_text("\n".join(f"{math.sin(0.3 * i):.6f},{i % 7}" for i in range(100)))
    for arguments, said in (
        ([str(recording), "--rig", str(tmp_path / "none.yaml")], "cannot be read"),
        ([str(recording), "--rig", str(rig)], "sampling rate"),
    ):
        monkeypatch.setattr(sys, "argv", ["mesotap", "diagnose", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 2, said


def test_the_list_of_mechanisms_holds_those_of_described_rigs():
    result = CliRunner().invoke(app, ["mechanisms"])
    assert result.exit_code == 0
    assert "spring_asymmetry" in result.output


def test_bodies_that_hang_together_need_no_ground():
    free = "bodies: {m: 1, n: 2}\njoints: [{between: [m, n]}]\n"
    assert parse_rig(free + SENSOR).arrangement.bodies == ("m", "n")


@pytest.mark.parametrize("unit", ["V", "mV/g", "um", "µm/s", "m/s^2", "mm s-2", "counts", "%", "N/mm", "rad", "V/s2"])
def test_units_of_the_field_are_known(unit):
    assert is_known_unit(unit)


@pytest.mark.parametrize("unit", ["furlong", "m/fortnight", "volt-ish", "xyz"])
def test_other_units_are_not(unit):
    assert not is_known_unit(unit)
