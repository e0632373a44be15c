"""What stands in files is shown by a terminal, and does nothing there."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table

from mesotap.answers.results_files import table_csv
from mesotap.operator.terminal import SafeConsole, escape, plain_lines

HOSTILE = st.text(st.characters() | st.sampled_from("\x1b\x07\r\n\t\x9b\u202e\u2066[]\\/a"))


def printed(*what: object) -> str:
    stream = io.StringIO()
    SafeConsole(file=stream, width=100_000).print(*what, highlight=False)
    return stream.getvalue()


@given(HOSTILE)
def test_a_text_becomes_one_printable_line(text: str) -> None:
    assert escape(text).isprintable()


@given(HOSTILE)
def test_no_text_acts_on_the_console(text: str) -> None:
    assert all(c.isprintable() or c == "\n" for c in printed(escape(text)))


@given(HOSTILE)
def test_no_text_is_markup_within_a_line(text: str) -> None:
    shown = printed(f"before {escape(text)} [bold]after[/bold]")
    assert shown.rstrip("\n").endswith(" after")


def test_a_table_is_made_plain_too() -> None:
    table = Table(title="\x1b[2J")
    table.add_column("\u202ea")
    table.add_row("\x9b31m")
    assert all(c.isprintable() or c == "\n" for c in printed(table))


def test_lines_stay_lines() -> None:
    assert plain_lines("a\nb\x1b") == "a\nb\\x1b"


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1+2", "@SUM(A1)", "\t=1", "\r=1", " =1"])
def test_a_text_is_no_formula(text: str) -> None:
    assert table_csv(["note"], [[text]]).splitlines()[1].lstrip('"').startswith("'")


def test_a_negative_number_stays_a_number() -> None:
    assert table_csv(["load"], [[-1.5]]) == "load\n-1.5\n"
