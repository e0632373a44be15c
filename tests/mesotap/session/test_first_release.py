"""What the first release left on disk (commit 344e942, simulated, seed 3): read, listed and resumed by this one."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from daq.session_file import read_session
from tests.mesotap.test_cli import mesotap

KEPT = Path(__file__).parent / "first_release"


def test_its_session_file_is_read():
    session = read_session(KEPT / "finished.h5")
    assert (session.software, session.specimen, session.complete) == ("mesotap 0.1.0 (simulated rig)", "first", True)
    assert [(s.load_set, s.accepted, s.acceleration.shape) for s in session.impacts] == [
        (load_set, True, (2, 1500)) for load_set in (0, 0, 1, 1)
    ]
    assert session.pre is not None
    assert len(session.pre.load_mn) == len(session.pre.voltage_mv) > 2


def test_its_k_c_is_found_again(tmp_path):
    """By today's analysis within three half widths of what it said itself; f2 within 0.1 %."""
    mesotap("analyze", KEPT / "finished.h5", "--json", tmp_path / "now.json")
    then, now = (
        json.loads(file.read_text())["loads"] for file in (KEPT / "finished-results.json", tmp_path / "now.json")
    )
    for before, after in zip(then, now, strict=True):
        assert after["f2_hz"]["value"] == pytest.approx(before["f2_hz"]["value"], rel=1e-3)
        k_c = before["contact_stiffness_n_per_m"]
        assert after["contact_stiffness_n_per_m"]["value"] == pytest.approx(
            k_c["value"], abs=1.5 * (k_c["high"] - k_c["low"])
        )


@pytest.mark.long
def test_its_unfinished_session_is_listed_and_resumed(tmp_path):
    folder = Path(shutil.copytree(KEPT / "unfinished", tmp_path / "s"))
    index = ("--index", tmp_path / "i.sqlite")
    (before,) = json.loads(mesotap("catalog", folder, *index, "--json", "-").stdout)["sessions"]
    assert (before["state"], before["specimen"], before["taps"]) == ("unfinished", "first", 1)
    done = mesotap("resume", folder)
    assert "its configuration is of another version" in done.stdout
    session = read_session(folder / "session.h5")
    assert session.complete
    assert sum(s.accepted for s in session.impacts) == 4
