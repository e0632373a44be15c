"""Recording the wire from the command line, and the bytes in the log."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from mesotap.commands import devices, session
from mesotap.commands.wire_options import WireOptions
from rig.drivers.wire_replay import read_recording
from rig.errors import RigError
from tests.mesotap.benches import SMALL

EMULATED = session.RigChoice(emulate=True, seed=1)


def silent() -> Console:
    return Console(file=io.StringIO())


def test_check_records_what_the_devices_said(tmp_path: Path) -> None:
    wire = WireOptions(tmp_path / "wire.jsonl")
    devices.check(None, SMALL, False, True, 1, False, None, silent(), wire)
    recording = read_recording(tmp_path / "wire.jsonl")
    assert recording.header["command"] == "check"
    assert set(recording.devices()) == {"micrometer stage", "strain-gauge amplifier"}
    assert any(act.data == b"1VE\r\n" for act in recording.acts)


def test_devices_records_what_the_devices_said(tmp_path: Path) -> None:
    devices.devices(None, SMALL, False, True, 1, None, silent(), False, WireOptions(tmp_path / "wire.jsonl"))
    assert len(read_recording(tmp_path / "wire.jsonl").acts) > 10


def test_nothing_is_begun_where_the_wire_cannot_be_recorded(tmp_path: Path) -> None:
    (tmp_path / "wire.jsonl").write_text("precious")
    with pytest.raises(RigError, match=r"wire\.jsonl: exists already"):
        session.run(None, SMALL, EMULATED, tmp_path / "run", None, silent(), WireOptions(tmp_path / "wire.jsonl"))
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_session_is_recorded_and_its_log_has_the_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_report", lambda *arguments: None)
    monkeypatch.setattr(session, "results_json", lambda results: {})
    changes = (*SMALL, "mesotap.diagnose=false", "mesotap.load_plan_mn=[300]")
    wire = WireOptions(tmp_path / "wire.jsonl", log=True)
    session.run(None, changes, EMULATED, tmp_path / "run", None, silent(), wire)
    acts = [json.loads(line) for line in (tmp_path / "wire.jsonl").read_text().splitlines()][1:]
    assert {act["device"] for act in acts} == {"micrometer stage", "strain-gauge amplifier", "recorder"}
    log = "".join(p.read_text() for p in sorted((tmp_path / "run").glob("session.log*"), reverse=True))
    assert " DEBUG mesotap.wire micrometer stage on " in log
    assert f"write {b'1VE'.hex()}0d0a" in log
