"""The udev rules: parsed as udev does, in a file that is read in time, and taken by udevadm where it can check them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from rig.drivers.usb1608_protocol import PRODUCT, VENDOR
from rig.drivers.usb_access import ADAPTERS, rules
from tests.mesotap.test_cli import mesotap, refused

TOKEN = re.compile(r'([A-Z]+)(?:\{([^}]+)\})?(==|!=|\+=|=)"([^"]*)"')
MATCHES = {"ACTION", "SUBSYSTEM", "ENV", "ATTR", "ATTRS", "KERNEL", "DRIVER"}


def parsed(text: str) -> list[list[tuple[str, str, str, str]]]:
    """Return key, its argument, operator and value of each part of each rule; all of a rule has to be such parts."""
    found = []
    for line in text.splitlines():
        if line and not line.startswith("#"):
            parts = line.split(", ")
            found.append([TOKEN.fullmatch(part).groups() for part in parts])  # type: ignore[union-attr]
    return found


def test_each_rule_matches_something_and_gives_it_to_the_person_at_the_machine() -> None:
    for rule in parsed(rules()):
        matched = {key for key, _, operator, _ in rule if operator in ("==", "!=")}
        given = [(key, argument, operator, value) for key, argument, operator, value in rule if operator in ("=", "+=")]
        assert matched <= MATCHES
        assert "SUBSYSTEM" in matched
        assert len(matched) >= 3
        assert ("TAG", None, "+=", "uaccess") in given or given == [("ATTR", "latency_timer", "=", "1")]


def test_nothing_is_opened_to_everybody() -> None:
    keys = {key for rule in parsed(rules()) for key, *_ in rule}
    assert not keys & {"MODE", "GROUP", "OWNER", "RUN", "PROGRAM"}


def test_the_recorder_and_the_adapters_are_in_it() -> None:
    values = [{(key, argument): value for key, argument, _, value in rule} for rule in parsed(rules())]
    recorder = {("ATTR", "idVendor"): "09db", ("ATTR", "idProduct"): "00ea", ("SUBSYSTEM", None): "usb"}
    assert (VENDOR, PRODUCT) == (0x09DB, 0x00EA)
    assert any(recorder.items() <= rule.items() for rule in values)
    serial = {rule.get(("ATTRS", "idVendor")) for rule in values if rule[("SUBSYSTEM", None)] == "tty"}
    assert serial == set(ADAPTERS)


def test_it_is_printed_or_written_with_what_to_do(tmp_path: Path) -> None:
    assert mesotap("udev").stdout == rules()
    said = mesotap("udev", "-o", tmp_path).stdout
    file = tmp_path / "70-mesotap.rules"
    assert file.read_text() == rules()
    assert f"sudo install -m 644 {file} /etc/udev/rules.d/" in said
    assert "sudo udevadm control --reload" in said
    answer = json.loads(mesotap("udev", "--json", "-").stdout)
    assert (answer["file"], answer["rules"], answer["install"][1]) == (None, rules(), "sudo udevadm control --reload")
    assert "exists already" in refused("udev", "-o", file)


def test_the_tag_is_acted_on_after_the_file(tmp_path: Path) -> None:
    assert "70-mesotap.rules" < "73-seat-late.rules"
    for name in ("99-mesotap.rules", "mesotap.rules", "70-mesotap"):
        assert "sort before 73-seat-late.rules" in refused("udev", "-o", tmp_path / name)
        assert not (tmp_path / name).exists()


def test_udevadm_takes_it(tmp_path: Path) -> None:
    if (
        shutil.which("udevadm") is None
        or subprocess.run(["udevadm", "verify", "--help"], capture_output=True).returncode
    ):
        pytest.skip("no udevadm verify here (systemd 254 has it)")
    file = tmp_path / "70-mesotap.rules"
    file.write_text(rules())
    done = subprocess.run(["udevadm", "verify", str(file)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
