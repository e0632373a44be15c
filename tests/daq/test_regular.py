"""Only files are opened, whatever has the name."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from daq.errors import RecordingError
from daq.regular import read_head, read_regular


@pytest.mark.parametrize(
    ("put", "said"),
    [
        (os.mkfifo, "is a pipe, not a file"),
        (Path.mkdir, "is a folder, not a file"),
        (lambda p: p.symlink_to("/dev/zero"), "is a device, not a file"),
        (lambda p: p.symlink_to("nowhere"), "there is no such file: it is a link to nowhere"),
        (lambda p: p.symlink_to(p.name), "cannot be read: Too many levels of symbolic links"),
        (lambda p: None, "there is no such file"),
        (lambda p: p.write_bytes(bytes(1001)), "is larger than 1 kB, too large for a test"),
    ],
)
def test_what_is_no_file_of_the_size_is_told(put: Callable[[Path], Any], said: str, tmp_path: Path) -> None:
    put(tmp_path / "x")
    with pytest.raises(RecordingError, match=said):
        read_regular(tmp_path / "x", 1000, "a test")


def test_a_name_that_no_file_can_have_is_told(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read"):
        read_regular(Path("a\0b"), 1000)


def test_a_file_is_read_whole_and_its_beginning_alone(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"abc")
    assert read_regular(tmp_path / "x", 3) == b"abc"
    assert read_head(tmp_path / "x", 2) == b"ab"


def test_no_descriptor_is_left_open(tmp_path: Path) -> None:
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    for put in (os.mkfifo, Path.mkdir):
        put(tmp_path / put.__name__)
        with pytest.raises(RecordingError):
            read_regular(tmp_path / put.__name__, 10)
    assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208


@pytest.mark.skipif(not Path("/proc/version").exists(), reason="no /proc on this machine")
def test_a_file_that_says_it_is_empty_and_is_not_is_refused():
    with pytest.raises(RecordingError, match="it is not a regular file"):
        read_regular(Path("/proc/version"), 10_000)


def test_an_empty_file_is_empty(tmp_path):
    (tmp_path / "empty").touch()
    assert read_regular(tmp_path / "empty", 10_000) == b""
