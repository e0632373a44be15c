"""The configuration that the operator's page tells to write is one."""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import dedent

from mesotap.configuration.config import parse_config
from rig.drivers.recorder_settings import Usb1608Settings
from rig.drivers.settings import AmplifierRtu, NewportStage

PAGE = Path(__file__).parents[3] / "docs" / "operator.md"


def blocks() -> list[str]:
    return [dedent(found) for found in re.findall(r"\n\n((?: {4,}.*\n)+)", PAGE.read_text(encoding="utf-8"))]


def test_the_parts_of_a_real_rig():
    (text,) = (block for block in blocks() if block.startswith("rig:"))
    parts = parse_config(text).rig.parts
    assert isinstance(parts.load_cell, AmplifierRtu)
    assert isinstance(parts.stage, NewportStage)
    assert isinstance(parts.accelerometers, Usb1608Settings)


def test_each_part_by_itself():
    alone = [block for block in blocks() if block.startswith(("load_cell:", "accelerometers:"))]
    assert len(alone) == 2
    registers, recorders = alone
    parts = parse_config("rig:\n  parts:\n" + "".join(f"    {line}\n" for line in registers.splitlines())).rig.parts
    assert isinstance(parts.load_cell, AmplifierRtu)
    assert parts.load_cell.map().signal.offset == 8192
    for line in recorders.splitlines():
        parse_config(f"rig:\n  parts:\n    {line}\n")
