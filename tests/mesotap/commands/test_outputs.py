"""What cannot be written is told before anything is computed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.errors import UnwrittenError
from daq.session_file import write_session
from mesotap import simulate
from mesotap.commands.outputs import make_ready
from tests.mesotap.configuration.test_usual_recordings import DECAY, as_csv, run

PROC = Path("/proc")
needs_proc = pytest.mark.skipif(not PROC.is_dir(), reason="no /proc here")


@needs_proc
def test_a_folder_in_which_no_file_can_be_made_is_told_at_once_and_truly() -> None:
    with pytest.raises(UnwrittenError, match=r"/proc/x\.json: .*no file can be made in this folder"):
        make_ready(PROC / "x.json", None)
    with pytest.raises(UnwrittenError, match="no file can be made in this folder"):
        make_ready(None, PROC)


def test_a_folder_that_is_not_there_and_a_folder_in_place_of_a_file_are_told(tmp_path: Path) -> None:
    with pytest.raises(UnwrittenError, match="the folder does not exist"):
        make_ready(tmp_path / "none" / "x.json", None)
    with pytest.raises(UnwrittenError, match="it is a folder; name a file"):
        make_ready(tmp_path, None)


def test_trying_leaves_everything_as_it_is(tmp_path: Path) -> None:
    there = tmp_path / "there.json"
    there.write_text("{}")
    make_ready(there, tmp_path / "made")
    make_ready(tmp_path / "new.json", None)
    make_ready(Path("-"), None)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["made", "there.json"]
    assert there.read_text() == "{}"


@pytest.mark.parametrize(
    "command",
    [
        ("analyze", "s.h5", "--report", "a.file/p"),
        ("analyze", "r.csv", "--report", "a.file/p"),
        ("analyze", "s.h5", "r.csv", "--report", "a.file/p"),
        ("report", "s.h5", "-o", "a.file/p"),
        ("published", "--report", "a.file/p"),
        ("diagnose", "--published", "flat", "--report", "a.file/p"),
        ("figures", "-o", "a.file/f"),
        ("prove", "-o", "a.file/x", "--sessions", "2"),
        ("prove", "--rigs", "-o", "a.file/x", "--sessions", "2"),
    ],
)
def test_a_folder_that_cannot_be_made_is_told_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    def computed(*_: object, **__: object) -> None:
        raise AssertionError("computed before the folder was tried")

    for place in (
        "mesotap.commands.files.analysed",
        "mesotap.commands.files.modes_of",
        "analysis.published.reanalyse",
        "mesotap.commands.theory.reanalyse",
        "mesotap.commands.theory.diagnose_published",
        "mesotap.proof.sealed.seal",
    ):
        monkeypatch.setattr(place, computed)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.file").write_text("it is kept")
    write_session(tmp_path / "s.h5", simulate())
    as_csv(tmp_path, np.array([DECAY, 0.5 * DECAY]))
    assert isinstance(run(*command).exception, UnwrittenError)
    assert (tmp_path / "a.file").read_text() == "it is kept"
