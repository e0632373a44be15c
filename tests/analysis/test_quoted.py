"""Numbers of the text beside the equations: which come out."""

import pytest

from analysis.quoted import Quoted, quoted_numbers

ROWS = {(row.what, row.quoted): row for row in quoted_numbers()}


@pytest.mark.parametrize(
    ("what", "quoted", "verdict"),
    [
        ("rough flats, R_q 10 nm, 50 mN", 17.0, "rounded"),
        ("rough flats, R_q 100 nm, 50 mN", 2.0, "rounded"),
        ("rough flats, R_q 1 um, 50 mN", 0.2, "rounded"),
        ("rough flats, R_q 10 nm, 1000 mN", 220.0, "no"),
        ("rough flats, R_q 100 nm, 1000 mN", 30.0, "no"),
        ("rough flats, R_q 1 um, 1000 mN", 3.6, "no"),
        ("smooth sphere, 50 mN", 1.3, "cut off"),
        ("smooth sphere, 1000 mN", 3.6, "cut off"),
        ("rough sphere, 50 mN", 0.43, "no"),
        ("rough sphere, 1000 mN", 1.2, "rounded"),
        ("smooth flat on a rigid half space", 58.9, "rounded"),
    ],
)
def test_numbers_of_figure_3(what, quoted, verdict):
    assert ROWS[what, quoted].verdict == verdict


def test_whatever_does_not_come_out_says_why():
    assert all(row.why for row in ROWS.values() if not row.comes_out)


@pytest.mark.parametrize(
    ("computed", "verdict"), [(1.26, "rounded"), (1.349, "rounded"), (1.36, "cut off"), (1.41, "no"), (1.24, "no")]
)
def test_verdict(computed, verdict):
    assert Quoted("", "", 1.3, "", 0.05, "", computed).verdict == verdict
