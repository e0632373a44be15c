"""The example package of docs/plugins.md: built, installed beside mesotap, and used; and packages that are broken."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from daq.session_file import read_session
from mesotap.configuration.config import default_text
from mesotap.configuration.declared import rig_settings
from mesotap.session import guardian_process
from rig.drivers import assembly, plugins
from rig.drivers.driver import Driver
from rig.drivers.plugins import DriverPlugin
from rig.plugins import module_of
from rig.settings import RigSettings
from tests.mesotap.installed import ROOT, Packages, wheel_of
from tests.rig.drivers.test_conformance import Carriage, Settings

PACKAGE = ROOT / "tests" / "example_package"
MODULES = PACKAGE / "mesotap_example"
GAUGE = "rig.parts.load_cell={driver: line-gauge, port: %s}"


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Packages:
    place = tmp_path_factory.mktemp("plugins")
    source = shutil.copytree(PACKAGE, place / "source")
    packages = Packages(place / "packages")
    packages.install(wheel_of(source, place))
    return packages


@pytest.fixture(scope="module")
def broken(tmp_path_factory) -> Packages:
    packages = Packages(tmp_path_factory.mktemp("broken") / "packages")
    packages.offer(
        "bad",
        drivers={"lost": "nowhere.at_all:DRIVER", "wrong": "json:loads", "conex-cc": "nowhere:DRIVER", "two": "json"},
        formats={"lost": "nowhere:FORMAT", "wrong": "json:loads", "csv": "nowhere:FORMAT"},
        mechanisms={"lost": "nowhere:MECHANISM"},
    )
    packages.offer("worse", drivers={"two": "json"})
    return packages


@pytest.mark.parametrize("module", ["line_gauge.py", "block_file.py"])
def test_the_examples_are_short_and_those_of_the_docs(module: str) -> None:
    text = (MODULES / module).read_text()
    assert len([line for line in text.splitlines() if line.strip()]) <= 60
    assert text in (ROOT / "docs" / "plugins.md").read_text()


@pytest.mark.slow
def test_they_are_listed_and_hold(installed: Packages, tmp_path: Path) -> None:
    assert "{driver: line-gauge, port: ..., baud_rate: ...}" in installed.mesotap("drivers", cwd=tmp_path).stdout
    assert ".blk: block files of an example recorder, of mesotap-example 1.0" in (
        installed.mesotap("formats", cwd=tmp_path).stdout
    )
    for command, name in (("drivers", "line-gauge"), ("formats", "blk"), ("mechanisms", "cubed_rate_damping")):
        said = installed.mesotap(command, "--check", name, cwd=tmp_path).stdout
        assert "FAILS" not in said
        assert len(said.splitlines()) >= 9


def test_a_mechanism_is_checked_by_its_entry_point_or_by_its_id(tmp_path: Path) -> None:
    packages = Packages(tmp_path / "packages")
    packages.offer("kit", mechanisms={"drag": "sim_backend.mechanisms.cable_drag:MECHANISM", "lost": "nowhere:M"})
    for name in ("drag", "cable_drag"):
        said = packages.mesotap("mechanisms", "--check", name, cwd=tmp_path).stdout
        assert "holds  the file holds a mechanism: cable_drag" in said
    assert "is neither" in packages.mesotap("mechanisms", "--check", "dra", cwd=tmp_path, code=2).stdout


@pytest.mark.slow
def test_a_format_is_checked_as_it_is_listed(installed: Packages, tmp_path: Path) -> None:
    assert "FAILS" not in installed.mesotap("formats", "--check", ".blk", cwd=tmp_path).stdout


@pytest.mark.slow
def test_the_driver_answers_where_the_configuration_names_it(installed: Packages, tmp_path: Path) -> None:
    with module_of(MODULES / "line_gauge.py", "tried").stand_in(None) as reached:
        change = GAUGE % reached["port"]
        installed.in_a_process("devices", "--set", change, "--json", "out.json", cwd=tmp_path)
    (cell,) = [p for p in json.loads((tmp_path / "out.json").read_text())["parts"] if p["part"] == "load_cell"]
    assert cell == {
        "part": "load_cell",
        "answers": True,
        "says": f"line gauge on {reached['port']}: answers, 0.3502 mV",
    }


@pytest.mark.slow
def test_its_settings_are_validated_and_kept(installed: Packages, tmp_path: Path) -> None:
    said = installed.refused("config", "check", "--set", "rig.parts.load_cell={driver: line-gauge}", cwd=tmp_path)
    assert "rig.parts.load_cell.port is missing" in said
    (tmp_path / "config.yaml").write_text("rig:\n  parts:\n    load_cell: {driver: line-gauge, port: a, bau_rate: 1}\n")
    said = installed.refused("config", "check", cwd=tmp_path)
    assert "line 3: rig.parts.load_cell.bau_rate is not a known key; did you mean baud_rate? allowed here: " in said
    (tmp_path / "config.yaml").write_text("rig: {parts: {load_cell: {driver: line-gauge, port: a}}}\n")
    shown = installed.mesotap("config", "show", cwd=tmp_path).stdout
    assert "load_cell: {driver: line-gauge, port: a, baud_rate: 9600}" in shown
    (tmp_path / "config.yaml").write_text(shown)
    assert installed.mesotap("config", "show", cwd=tmp_path).stdout == shown
    said = installed.refused("config", "check", "--set", "rig.parts.stage={driver: line-gauge}", cwd=tmp_path)
    assert "line-gauge is a driver of rig.parts.load_cell" in said


@pytest.mark.slow
def test_a_rig_with_it_is_simulated_but_not_emulated(installed: Packages, tmp_path: Path) -> None:
    change = ("--set", GAUGE % "/dev/ttyUSB7")
    installed.mesotap("check", "--simulate", "--no-touch", *change, cwd=tmp_path)
    said = installed.refused("check", "--emulate", "--no-touch", *change, cwd=tmp_path)
    assert "rig.parts.load_cell: nothing is emulated for line-gauge" in said


@pytest.mark.slow
def test_a_session_keeps_its_rig_where_its_driver_is_not_installed(installed: Packages, tmp_path: Path) -> None:
    changes = ("--set", GAUGE % "/dev/ttyUSB7", "--set", "rig.masses.m1_kg=0.110", "--set", "rig.filter.lowpass_hz=9e3")
    installed.mesotap("simulate", "tap.h5", *changes, cwd=tmp_path)
    kept = rig_settings(read_session(tmp_path / "tap.h5"))
    assert (kept.masses.m1_kg, kept.filter.lowpass_hz, kept.parts.load_cell) == (0.110, 9e3, "simulated")


@pytest.mark.slow
def test_the_format_is_read_by_every_command(installed: Packages, tmp_path: Path) -> None:
    content, _ = module_of(MODULES / "block_file.py", "tried").example()
    (tmp_path / "r.BLK").write_bytes(content)
    installed.mesotap("info", "r.BLK", "--json", "info.json", cwd=tmp_path)
    assert json.loads((tmp_path / "info.json").read_text())["channels"] == ["A", "B"]
    installed.mesotap("analyze", "r.BLK", "--json", "modes.json", cwd=tmp_path)
    found = [mode["frequency_hz"]["value"] for mode in json.loads((tmp_path / "modes.json").read_text())["modes"]]
    assert np.allclose(sorted(found), [356.0, 1904.0], rtol=1e-3)
    installed.mesotap("import", "r.BLK", "out.h5", cwd=tmp_path)
    (tmp_path / "r.blk").write_bytes(content[:1000])
    assert "r.blk: is damaged: 2 channels of 2000 samples do not fill it" in installed.refused(
        "info", "r.blk", cwd=tmp_path
    )


def test_a_broken_package_is_told_where_it_is_asked_for(broken: Packages, tmp_path: Path) -> None:
    def configured(name: str) -> str:
        return broken.refused("config", "check", "--set", f"rig.parts.load_cell={{driver: {name}}}", cwd=tmp_path)

    assert "entry point lost (nowhere.at_all:DRIVER) of bad 1: cannot be imported: ModuleNotFoundError" in (
        configured("lost")
    )
    assert "entry point wrong (json:loads) of bad 1: holds no DRIVER, a DriverPlugin" in configured("wrong")
    assert "the driver two is offered by bad 1 and worse 1; take one of them out" in configured("two")
    (tmp_path / "r.lost").write_text("1 2\n" * 20)
    assert "r.lost: entry point lost (nowhere:FORMAT) of bad 1: cannot be imported" in broken.refused(
        "info", "r.lost", cwd=tmp_path
    )
    (tmp_path / "r.wrong").write_text("1 2\n" * 20)
    assert "r.wrong: entry point wrong (json:loads) of bad 1: holds no FORMAT" in broken.refused(
        "info", "r.wrong", cwd=tmp_path
    )
    lost = "entry point lost (nowhere:MECHANISM) of bad 1: cannot be imported"
    assert lost in broken.refused("simulate", "t.h5", "--set", "sim_backend.mechanisms=[{id: none_such}]", cwd=tmp_path)


def test_a_broken_package_is_listed_with_its_fault(broken: Packages, tmp_path: Path) -> None:
    said = broken.mesotap("drivers", "--json", "drivers.json", cwd=tmp_path).stdout
    assert (
        "cannot be used: entry point conex-cc (nowhere:DRIVER) of bad 1: conex-cc is a driver of mesotap's own" in said
    )
    listed = json.loads((tmp_path / "drivers.json").read_text())["drivers"]
    assert {item["name"] for item in listed} == {"lost", "wrong", "conex-cc", "two"}
    assert not any(item["usable"] for item in listed)
    assert ".csv" in broken.mesotap("formats", cwd=tmp_path).stdout
    mechanisms = broken.mesotap("mechanisms", "--json", "mechanisms.json", cwd=tmp_path)
    fault = "entry point lost (nowhere:MECHANISM) of bad 1: cannot be imported"
    assert f"cannot be used and is left out: {fault}" in mechanisms.stderr
    assert "guide_friction" in mechanisms.stdout
    (said,) = json.loads((tmp_path / "mechanisms.json").read_text())["left_out"]
    assert said.startswith(fault)
    for command in ("drivers", "formats", "mechanisms"):
        assert "FAILS" in broken.mesotap(command, "--check", "lost", cwd=tmp_path, code=2).stdout


def test_a_broken_package_breaks_nothing_else(broken: Packages, tmp_path: Path) -> None:
    (tmp_path / "my.yaml").write_text(default_text())
    broken.mesotap("config", "check", "my.yaml", cwd=tmp_path)
    hertz = "sim_backend.mechanisms=[{id: contact_loss}]"
    broken.mesotap("simulate", "tap.h5", "--set", hertz, cwd=tmp_path)
    (tmp_path / "r.csv").write_text("t,a,b\n" + "".join(f"{i / 1000},{i % 7},{i % 5}\n" for i in range(64)))
    broken.mesotap("info", "r.csv", cwd=tmp_path)
    stage = "{driver: conex-cc, port: /dev/ttyUSB9, resolution_um: 0.02}"
    said = broken.mesotap("devices", "--set", f"rig.parts.stage={stage}", cwd=tmp_path).stdout
    assert "stage: no answer: micrometer stage on /dev/ttyUSB9: " in said


def test_the_guardian_takes_the_surfaces_apart_with_another_packages_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Carriage] = []

    class Motor(Carriage, Driver):
        def connect(self) -> str:
            made.append(self)
            if len(made) == 1:
                raise OSError("the port is still taken")
            return "answers"

        def close(self) -> None:
            pass

    plugin = DriverPlugin("mine", "stage", Settings, Motor)
    for module in (plugins, assembly):
        monkeypatch.setattr(module, "installed", lambda name: plugin)
    monkeypatch.setattr(guardian_process, "TRY_AGAIN_S", 0.0)
    settings = RigSettings.model_validate({"parts": {"stage": {"driver": "mine"}}})
    setup = {"rig": settings.model_dump(mode="json"), "folder": None, "scale": [0.042, 0.0], "bus": None}
    safe = guardian_process.Successor({**setup, "descriptors": []}, {})._retract()
    assert safe.moved_um == -made[1].at == settings.limits.clearance_um
