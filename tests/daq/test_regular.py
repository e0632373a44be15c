"""What only looks like a file is not read."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.errors import RecordingError
from daq.regular import read_regular


@pytest.mark.skipif(not Path("/proc/version").exists(), reason="no /proc on this machine")
def test_a_file_that_says_it_is_empty_and_is_not_is_refused():
    with pytest.raises(RecordingError, match="it is no file that stays as it is"):
        read_regular(Path("/proc/version"), 10_000)


def test_an_empty_file_is_empty(tmp_path):
    (tmp_path / "empty").touch()
    assert read_regular(tmp_path / "empty", 10_000) == b""
