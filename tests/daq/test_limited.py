"""A function that reads runs in a process with limits, and what happens to it is told in one sentence."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from daq import limited
from daq.errors import RecordingError
from daq.limited import read_limited
from daq.limited_child import no_more_files
from daq.limited_reply import NoReply, decoded, empty_arrays, encoded
from daq.limits import LARGEST_ARRAY, data_room, memory_room

pytestmark = pytest.mark.usefixtures("in_new_processes")


@dataclass
class Kept:
    """Something of every kind that can be answered."""

    text: str
    values: np.ndarray[Any, Any]
    inner: tuple[Any, ...]
    more: dict[str, Any]


def test_what_is_encoded_comes_back() -> None:
    arrays: list[Any] = []
    value = Kept("\x1b\udcff", np.arange(6.0).reshape(2, 3), ([1, None], (True, -2.5)), {"a": [1, {"b": "c"}]})
    again = decoded(encoded(value, arrays), arrays, {"Kept": Kept})
    assert (again.text, again.inner, again.more) == (value.text, value.inner, value.more)
    assert np.array_equal(again.values, value.values)


def test_an_answer_names_no_class_that_was_not_asked_for() -> None:
    with pytest.raises(NoReply):
        decoded(["Popen", {"args": "id"}], [], {"Kept": Kept})


@pytest.mark.parametrize("shapes", [[[10**12]], [[-1]], [[1.5]], [["2"]], "x", [None], [[True]]])
def test_room_is_made_for_no_array_beyond_the_limit(shapes: Any) -> None:
    with pytest.raises(NoReply):
        empty_arrays(shapes, 1000)


@pytest.mark.parametrize("size", [0, 1000, 10**6, 10**9])
def test_both_processes_together_stay_below_2_gb_of_data(size: int) -> None:
    assert data_room(size) <= 8 * LARGEST_ARRAY
    assert memory_room(size) < 2e9


PATIENCE_S = 120.0
"""For a child that answers at once, on a machine that does other things too."""


def child(text: str) -> list[str]:
    """A child that does something else than what it was asked."""
    return [sys.executable, "-c", text]


@pytest.mark.parametrize(
    ("does", "said"),
    [
        ("import os; os.kill(os.getpid(), 11)", "the library that reads it failed"),
        ("import os; os.kill(os.getpid(), 24)", "takes longer"),
        ("import os; os.kill(os.getpid(), 9)", "was killed"),
        ("pass", "ended"),
        ("import os; os.write(1, bytes(7))", "ended"),
        ("import os; os.write(1, b'\\xff' * 8)", "its texts take more than 64 MB"),
        ("import os; os.write(1, (5).to_bytes(8, 'little') + b'hello')", "answered something else"),
        ("import time; time.sleep(60)", "was not read within 1 s"),
        (
            "import json, os; t = json.dumps({'value': 1, 'arrays': [[10**9]]}).encode();"
            "os.write(1, len(t).to_bytes(8, 'little') + t)",
            "8000000000 bytes are more than",
        ),
    ],
)
def test_whatever_the_child_does_is_a_sentence(
    does: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = subprocess.Popen
    wall_s = 1.0 if "sleep" in does else PATIENCE_S
    monkeypatch.setattr(limited, "longest_read_s", lambda size: (1.0, wall_s))
    monkeypatch.setattr(limited.subprocess, "Popen", lambda command, **options: start(child(does), **options))
    with pytest.raises(RecordingError, match=said):
        read_limited(os.path.getsize, tmp_path / "x")


def test_the_child_is_gone_when_the_reading_is_interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started = []
    start = subprocess.Popen

    def begin(command: list[str], **options: Any) -> Any:
        started.append(start(child("import time; time.sleep(60)"), **options))
        return started[-1]

    def interrupted(*arguments: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(limited.subprocess, "Popen", begin)
    monkeypatch.setattr(limited, "_received", interrupted)
    with pytest.raises(KeyboardInterrupt):
        read_limited(os.path.getsize, tmp_path / "x")
    assert started[0].returncode == -signal.SIGKILL


def test_no_link_reaches_another_file_while_one_is_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["x"] = 1.0
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["x"] = h5py.ExternalLink("other.h5", "/x")
    with h5py.File(tmp_path / "x.h5") as file, no_more_files(), pytest.raises((KeyError, OSError)):
        file["x"][()]
    with h5py.File(tmp_path / "x.h5") as file:
        assert file["x"][()] == 1.0
