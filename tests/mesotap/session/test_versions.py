"""A session that another version of the program began."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from daq.journal import SessionFolder
from mesotap.commands import session
from mesotap.configuration.config import ConfigError
from mesotap.session.header import FOLDER_VERSION, SOFTWARE, kept_config


@pytest.fixture
def folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(session, "_report", lambda *arguments: None)
    monkeypatch.setattr(session, "results_json", lambda results: {})
    return folder


def resumed(folder: Path, **header: object) -> str:
    """Resume with a header that was written like this; what was said."""
    kept = json.loads((folder / "session.json").read_text())
    kept.update(header)
    (folder / "session.json").write_text(json.dumps(kept))
    console = Console(file=io.StringIO(), width=1000)
    session.resume(folder, None, console)
    return console.file.getvalue()  # type: ignore[attr-defined]


def versions(folder: Path) -> list[dict[str, object]]:
    with SessionFolder.open(folder) as opened:
        return [e for e in opened.events() if e["event"] == "version"]


def test_another_version_goes_on_and_says_so_in_the_journal(folder: Path) -> None:
    said = resumed(folder, software="mesotap 0.0.1")
    assert f"was run by mesotap 0.0.1, {SOFTWARE} goes on" in said
    (noted,) = versions(folder)
    assert (noted["software"], noted["before"]) == (SOFTWARE, "mesotap 0.0.1")
    assert (folder / "session.h5").exists()


def test_the_same_version_has_nothing_to_say(folder: Path) -> None:
    assert "goes on" not in resumed(folder, software=SOFTWARE)
    assert versions(folder) == []


def test_keys_of_another_version_are_told_and_left_out_and_missing_ones_take_their_defaults(folder: Path) -> None:
    config = json.loads((folder / "session.json").read_text())["config"]
    other = config.replace("dwell_s:", "dwell_of_old_s:").replace("poll_s:", "poll_s:")
    said = resumed(folder, software="mesotap 0.0.1", config=other)
    assert "keys unknown here are left out: mesotap.dwell_of_old_s" in said
    assert "keys it lacks take defaults: mesotap.dwell_s" in said
    (noted,) = versions(folder)
    assert noted["left_out"] == ["mesotap.dwell_of_old_s"]
    assert noted["defaults"] == ["mesotap.dwell_s"]


def test_a_session_of_an_older_configuration_goes_on_with_the_same_settings(folder: Path) -> None:
    kept = json.loads((folder / "session.json").read_text())["config"]
    older = kept.replace("version: 2\n", "").replace("contact_stiffness_n_per_um", "contact_stiffness_mn_per_m")
    older = older.replace("stage: simulated", "stage: motor")
    assert older.count("motor") == older.count("mn_per_m") == 1
    assert kept_config(older, "text").config == kept_config(kept, "text").config
    said = resumed(folder, config=older)
    assert "of another version" not in said
    assert (folder / "session.h5").exists()


def test_it_is_noted_once(folder: Path) -> None:
    resumed(folder, software="mesotap 0.0.1")
    assert "goes on" not in resumed(folder)
    assert len(versions(folder)) == 1


def test_a_folder_of_a_newer_format_is_left_alone(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"was written by a newer version \(mesotap 9, format \d+\)"):
        resumed(folder, software="mesotap 9", format_version=FOLDER_VERSION + 1)


def test_an_unknown_key_within_a_driver_is_left_out() -> None:
    text = "rig: {parts: {stage: {driver: conex-cc, port: /dev/ttyUSB1, resolution_um: 0.02, of_old: 3}}}"
    kept = kept_config(text, "text")
    assert kept.left_out == ("rig.parts.stage.of_old",)
    assert kept.config.rig.parts.stage.port == "/dev/ttyUSB1"  # type: ignore[union-attr]


def test_text_with_any_line_end_outlives_a_key_that_is_left_out() -> None:
    kept = kept_config('mesotap: {title: "a\\u2028b", of_old: 3}', "text")
    assert kept.left_out == ("mesotap.of_old",)
    assert kept.config.mesotap.title == "a\u2028b"


def test_a_value_that_is_not_allowed_is_not_passed_over() -> None:
    with pytest.raises(ConfigError, match=r"rig\.masses\.m1_kg is -1"):
        kept_config("rig: {masses: {m1_kg: -1, of_old: 3}}", "text")
