"""The checks of a file format find what a reader does wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.exchange.conformance import conformance

GOOD = """
import struct
import numpy as np
from daq.errors import RecordingError
from daq.exchange.formats import FormatPlugin
from daq.exchange.recording import Columns

def read(path):
    content = path.read_bytes()
    if content[:2] != b"OK" or len(content) != 2 + 8 * 32:
        raise RecordingError(f"{path}: is none of these")
    return Columns(["a"], ["g"], [np.frombuffer(content, "<f8", offset=2).copy()], rate_hz=100.0)

def example():
    data = np.linspace(-1, 1, 32)
    return b"OK" + data.astype("<f8").tobytes(), Columns(["a"], ["g"], [data], rate_hz=100.0)

FORMAT = FormatPlugin("okay", read, example)
"""
REFUSES = 'if content[:2] != b"OK" or len(content) != 2 + 8 * 32:'
CUT = "a file that is cut is read or refused in a sentence"
OTHER = "another file of that name is refused in a sentence"


def failing(folder: Path, text: str) -> dict[str, str]:
    file = folder / "mine.py"
    file.write_text(text)
    return {check.name: check.said for check in conformance(str(file)) if not check.holds}


def test_a_reader_as_it_should_be_passes(tmp_path: Path) -> None:
    assert failing(tmp_path, GOOD) == {}


@pytest.mark.parametrize(
    ("old", "new", "check", "said"),
    [
        ('"okay"', '"csv"', "its ending is free", "mesotap itself reads .csv"),
        ('"okay"', '".OK"', "it is a format", "its ending '.OK' is not"),
        ("FORMAT =", "FROMAT =", "it is a format", "holds no FORMAT"),
        (REFUSES, 'if content[:2] != b"OK":', CUT, "the reader of this format failed: ValueError"),
        (REFUSES, "if False:", OTHER, "failed"),
        ('["g"], [np', '["m/s2"], [np', "its example is read as it was written", "expected ['a'] in ['g']"),
        ('.copy()]', '.copy() * 2]', "its example is read as it was written", "a holds other numbers"),
        ('return Columns(["a"]', 'return (["a"]', "its example can be read", ""),
        ("offset=2).copy()", "offset=2).astype(int)", "its example can be read", "no array (n,) of floating-point"),
        ("content = path.read_bytes()", "path.with_suffix('.x').write_text('x'); content = path.read_bytes()",
         "its example can be read", "failed: OSError"),
    ],
    ids=lambda value: value[:12],
)  # fmt: skip
def test_what_a_reader_does_wrong_is_found(tmp_path: Path, old: str, new: str, check: str, said: str) -> None:
    assert old in GOOD
    text = GOOD.replace(old, new, 1)
    if new.startswith("return (["):
        text = text.replace("rate_hz=100.0)", "100.0)", 1)
    assert said in failing(tmp_path, text)[check]
