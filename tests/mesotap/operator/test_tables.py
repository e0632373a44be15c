"""Tables fold at any width, and no number is cut."""

from __future__ import annotations

import doctest
import io
from pathlib import Path

import pytest

from mesotap.cli_options import console
from mesotap.operator import tables
from mesotap.operator.tables import Table
from mesotap.operator.terminal import SafeConsole

HEADINGS = ("load, mN", "impacts", "f1, Hz", "f2, Hz", "zeta1, %", "zeta2, %", "k_c, MN/m", "c_c, N s/m")
ROWS = [
    f"{26 + i}4.9 ± 2.1|{i + 1}|355.1{i} ± 0.02|1523.4{i} ± 0.71|0.498 ± 0.003|0.7{i}52 ± 0.0011|4.46{i} ± 0.04|12 ± 1"
    for i in range(8)
]


def printed(width: int, keys: int = 1) -> str:
    shown = Table(title="some.wav: era, 95 % intervals", keys=keys)
    for heading in HEADINGS:
        shown.add_column(heading, justify="right")
    for row in ROWS:
        shown.add_row(*row.split("|"))
    stream = io.StringIO()
    SafeConsole(file=stream, width=width).print(shown)
    return stream.getvalue()


@pytest.mark.parametrize("width", [12, 15, 20, 30, 40, 60, 80, 100, 137, 160])
def test_no_number_is_cut_and_no_line_is_wider(width: int) -> None:
    text = printed(width)
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    whole = text.replace("│", " ").replace("┃", " ").split()
    assert set(" ".join((*HEADINGS, *ROWS)).replace("|", " ").split()) <= {word.rstrip(":") for word in whole}


def test_further_tables_repeat_what_a_row_is_of() -> None:
    assert printed(60).count("264.9") == 2
    assert printed(60, keys=2).count("impacts") > 1


def test_a_table_that_fits_is_one() -> None:
    assert printed(160).count("264.9") == 1
    assert printed(160).count("┏") == 1


def test_a_long_name_folds() -> None:
    shown = Table("file", "size")
    shown.add_row("x" * 100, "12.5")
    stream = io.StringIO()
    SafeConsole(file=stream, width=40).print(shown)
    assert stream.getvalue().count("x") == 100
    assert "12.5" in stream.getvalue()


@pytest.mark.parametrize(("columns", "width"), [("60", 60), ("", 160), ("many", 160)])
def test_a_pipe_is_as_wide_as_columns_says(monkeypatch: pytest.MonkeyPatch, columns: str, width: int) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert console(Path("-")).width == width


def test_examples() -> None:
    assert doctest.testmod(tables).failed == 0
