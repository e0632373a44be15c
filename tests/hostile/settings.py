"""Configurations, rig files and diagnoses made to expand, to disarm, or to say what terminals act on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tests.hostile.case import Case
from tests.hostile.hdf5_files import HOSTILE_TEXT, MERGE_BOMB

ALIAS_BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "\n".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 9)}]" for i in range(12)
)


def config(content: str | bytes) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "c.yaml").write_bytes(content.encode() if isinstance(content, str) else content)
        return ["config", "check", "c.yaml"]

    return make


def limit(key: str, value: object) -> str:
    return f"rig: {{limits: {{{key}: {value}}}}}"


CONFIGS: tuple[tuple[str, str | bytes, dict[str, Any]], ...] = (
    ("a merge bomb", MERGE_BOMB, {"says": "aliases stand for more than", "quick": True}),
    ("an alias bomb", ALIAS_BOMB, {"says": "aliases stand for more than", "quick": True}),
    ("an alias bomb in a section", ALIAS_BOMB + "\nmesotap: *h", {"says": "aliases stand for more than"}),
    ("an alias of itself", "a: &a [*a]", {"says": "inside of what it stands for"}),
    ("a merge of itself", "a: &a {<<: *a}", {"says": "inside of what it stands for"}),
    ("10,000 lists within lists", "[" * 10_000, {"says": "not YAML"}),
    ("30,000 maps within maps", "{a: " * 30_000, {"says": "c.yaml"}),
    (
        "a key given twice",
        "mesotap: {dwell_s: 1}\nrig: {}\nmesotap: {dwell_s: 2}",
        {"says": "line 1 and in line 3", "quick": True},
    ),
    ("a limit given twice", "rig:\n  limits:\n    load_mn: 1100\n    load_mn: 9000", {"says": "line 3 and in line 4"}),
    ("5 MB of comments", "# comment\n" * 500_000, {"says": "100 kB"}),
    ("99 kB of dashes", "- " * 49_000, {"says": "c.yaml"}),
    ("an object of Python", "!!python/object/apply:os.system [id]", {"says": "c.yaml"}),
    ("UTF-16", "a: 1".encode("utf-16"), {"says": "not a text"}),
    ("noise", bytes(range(256)) * 10, {"says": "c.yaml"}),
    ("zeros", bytes(1000), {"says": "c.yaml"}),
    ("a load limit of 1e29", limit("load_mn", 1e29), {"says": "rig.limits.load_mn", "quick": True}),
    ("a load limit of infinity", limit("load_mn", ".inf"), {"says": "rig.limits.load_mn"}),
    ("a load limit that is not a number", limit("load_mn", ".nan"), {"says": "rig.limits.load_mn"}),
    ("a step of 1 m", limit("largest_approach_step_um", 1e6), {"says": "largest_approach_step_um"}),
    ("readings of last year", limit("stale_reading_s", 3e7), {"says": "stale_reading_s"}),
    ("a million frozen readings", limit("frozen_readings", 10**6), {"says": "frozen_readings"}),
    ("a contact at 1e9 mN", limit("contact_threshold_mn", 1e9), {"says": "contact_threshold_mn"}),
    ("a backlash of 1 m", limit("largest_backlash_um", 1e6), {"says": "largest_backlash_um", "lines": True}),
    ("a contact 1 km away", limit("expected_contact_um", 1e9), {"says": "expected_contact_um"}),
    ("no interlock", "rig: {limits: null}", {"says": "rig.limits"}),
    ("an interlock switched off", "rig: {limits: off}", {"says": "rig.limits"}),
    ("a gauge of 1e30 mV/mN", "rig: {gauge_sensitivity_mv_per_mn: 1.0e+30}", {"says": "gauge_sensitivity"}),
    ("a tolerance of 1e9 mN", "mesotap: {load_tolerance_mn: 1.0e+9}", {"says": "load_tolerance_mn"}),
    ("a dwell of a century", "mesotap: {dwell_s: 3.0e+9}", {"says": "dwell_s"}),
    ("a wait of a century", "daq: {trigger: {timeout_s: 3.0e+9}}", {"says": "timeout_s"}),
    ("2000 loads", f"mesotap: {{load_plan_mn: {[100.0] * 2000}}}", {"says": "more than 1000"}),
    ("a filter of 10^6 poles", "rig: {filter: {highpass_order: 1000000}}", {"says": "highpass_order"}),
    ("a number of 10,000 digits", "mesotap: {dwell_s: " + "9" * 10_000 + "}", {"says": "c.yaml"}),
    ("a number of sixties", "mesotap: {dwell_s: 1" + ":59" * 20_000 + "}", {"says": "c.yaml"}),
    ("a key that acts on terminals", '"\\e]0;x\\a\\e[31m": 1', {"says": "\\x1b]0;x"}),
    ("a key that turns the writing", '"\\u202Ex": 1', {"says": "\\u202e"}),
    ("a value that acts on terminals", 'mesotap: {dwell_s: "\\e[31m"}', {"says": "dwell_s"}),
    ("an operator that acts on terminals", 'mesotap: {operator: "\\e[31m\\n\\u202E"}', {"shows": "good"}),
    ("a date for a number", "mesotap: {dwell_s: 9999-99-99}", {"says": "c.yaml"}),
    ("a set for a section", "rig: !!set {a, b}", {"says": "rig"}),
    ("a list at the top", "- 1\n- 2", {"says": "not a configuration"}),
)

RIG = (
    "bodies: {{{body}: 1.0}}\nsprings: [{{between: [{body}, ground]}}]\n"
    "sensors: [{{channel: a, of: {body}, shows: {shows}}}]\n"
)


def rig(content: str) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "rig.yaml").write_text(content, encoding="utf-8")
        rows = "\n".join(f"{i / 1000},{i % 7}" for i in range(64))
        (folder / "x.csv").write_text(f"t,a\n{rows}\n", encoding="utf-8")
        return ["diagnose", "--rig", "rig.yaml", "x.csv"]

    return make


RIGS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("a merge bomb", MERGE_BOMB, {"says": "aliases stand for more than", "quick": True}),
    ("an alias bomb", ALIAS_BOMB, {"says": "aliases stand for more than"}),
    ("a body given twice", "bodies:\n  a: 1.0\n  a: 2.0\nsensors: []", {"says": "line 2 and in line 3"}),
    ("a body that is markup", RIG.format(body='"[/red]"', shows="speed"), {"says": "shows", "lines": True}),
    ("a body that acts on terminals", RIG.format(body='"\\e[31m"', shows="speed"), {"says": "shows", "lines": True}),
    (
        "a sensor of nobody",
        RIG.format(body="m", shows="velocity").replace("of: m", 'of: "\\e[2J"'),
        {"says": "not a body"},
    ),
    (
        "a mass of 1e400",
        RIG.format(body="m", shows="velocity").replace("1.0", "1.0e+400"),
        {"says": "rig.yaml", "lines": True},
    ),
    ("a band of nothing", RIG.format(body="m", shows="velocity") + "recording: {band_hz: [5, 1]}", {"says": "band_hz"}),
    ("2 MB of bodies", "bodies: {" + ", ".join(f"b{i}: 1.0" for i in range(200_000)) + "}", {"says": "100 kB"}),
)


def diagnosis(content: str | bytes) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "d.json").write_bytes(content.encode() if isinstance(content, str) else content)
        return ["adopt", "d.json"]

    return make


def named(mechanism: str, value: Any = 1.0, parameter: str = "p") -> str:
    parameters = {parameter: {"value": value}}
    content = {"mechanisms": [{"id": mechanism, "parameters": parameters}], "verdict": HOSTILE_TEXT}
    return json.dumps({"format": "mesotap-diagnosis", "version": 1, **content})


DIAGNOSES: tuple[tuple[str, str | bytes, dict[str, Any]], ...] = (
    ("100,000 lists within lists", "[" * 100_000, {"says": "not JSON", "quick": True}),
    ("100,000 maps within maps", '{"a":' * 100_000, {"says": "not JSON"}),
    ("a number of 100,000 digits", '{"version": ' + "9" * 100_000 + "}", {"says": "not JSON"}),
    ("30 MB", "[" + "1," * 15_000_000 + "1]", {"says": "16 MB"}),
    ("no mapping", "[1, 2]", {"says": "is not a mesotap-diagnosis"}),
    ("another format", '{"format": "mesotap-results", "version": 1}', {"says": "is not a mesotap-diagnosis"}),
    ("nothing of a diagnosis", '{"format": "mesotap-diagnosis", "version": 1}', {"says": "not a complete"}),
    (
        "no mechanism",
        '{"format": "mesotap-diagnosis", "version": 1, "mechanisms": [], "verdict": "\\u001b[31m"}',
        {"says": "nothing to adopt"},
    ),
    ("an unknown mechanism", named("nothing"), {"says": "nothing"}),
    ("a mechanism that acts on terminals", named(HOSTILE_TEXT), {"says": "d.json"}),
    ("a mechanism that is markup", named("[/red]"), {"says": "d.json"}),
    (
        "a value of 1e400",
        named("hunt_crossley_damping", parameter="damping_growth_per_relative_approach").replace("1.0", "1e400"),
        {"says": "not a number"},
    ),
    ("a value that is a text", named("hunt_crossley_damping", HOSTILE_TEXT), {"says": "not a number"}),
    (
        "a value of 1e308",
        named("hunt_crossley_damping", 1e308, "damping_growth_per_relative_approach"),
        {"either": True},
    ),
    ("half a letter", b'{"format": "\xff"}', {"says": "not JSON"}),
    ("nothing", b"", {"says": "not JSON"}),
)


def truths(content: str) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "practice").mkdir()
        (folder / "practice" / "truth.json").write_text(content, encoding="utf-8")
        return ["prove", "--practice", "practice", "--output", "proof"]

    return make


TRUTHS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("100,000 lists within lists", "[" * 100_000, {"says": "is not JSON"}),
    ("a number of 100,000 digits", "9" * 100_000, {"says": "is not JSON"}),
    ("a session elsewhere", '{"../../etc/passwd": {"kinds": [], "d": 1}}', {"says": "is missing"}),
    ("a session that acts on terminals", '{"\\u001b[2J\\n": {"kinds": [], "d": 1}}', {"says": "is missing"}),
    ("no sessions", "[]", {"says": "expected an object"}),
)


def cases() -> Iterator[Case]:
    for name, content, how in TRUTHS:
        yield Case("truths", name, truths(content), **how)
    for name, content, how in CONFIGS:
        yield Case("configurations", name, config(content), **how)
    for name, content, how in RIGS:
        yield Case("rig files", name, rig(content), **how)
    for name, given, how in DIAGNOSES:
        yield Case("diagnoses", name, diagnosis(given), **how)
    for change in (
        "rig.limits.load_mn=1e29",
        "mesotap=[&a [*a]]",
        "\x1b[31m=1",
        "a.b.c=[",
        "mesotap.dwell_s={a: 1, a: 2}",
    ):
        yield Case("configurations", f"--set {change!r}", lambda folder, c=change: ["config", "check", "--set", c])
