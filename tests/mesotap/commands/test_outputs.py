"""What cannot be written is told before anything is computed."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.errors import UnwrittenError
from mesotap.commands.outputs import make_ready

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
