"""Where a remainder lies, and how that is said."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.answer import Location
from analysis.mismatch.remainder import frequency_words, remainder_statement, spread_of


def test_a_remainder_is_located_where_its_power_is() -> None:
    edges = np.linspace(0, 10_000, 101)
    power = np.ones((2, 100))
    power[0, 40:42] = 5.0
    assert spread_of(edges, power, power > 2) == (4000.0, 4200.0)


@pytest.mark.parametrize(
    ("band", "said"),
    [((4000.0, 4200.0), "at 4.1 kHz"), ((3300.0, 4100.0), "from 3.3 to 4.1 kHz"), ((80.0, 81.0), "at 80.5 Hz")],
)
def test_a_band_is_told_by_its_middle_where_it_is_narrow(band: tuple[float, float], said: str) -> None:
    assert frequency_words(band) == said


@pytest.mark.parametrize(
    ("chi_squared", "said"),
    [
        (
            0.0,
            "Something is left beyond noise (p = 0.002) at 80.5 Hz. No force or channel of any shape would take it "
            "away; of what was tried, what fits it best acts in the spring (leaf).",
        ),
        (
            12.0,
            "Something is left beyond noise (p = 0.002), 0.5 % of what Eq. 9 misses: forces or channels of any shape "
            "would take away a chi-squared of 12 beyond chance; it lies in the spring (leaf) at 80.5 Hz.",
        ),
    ],
)
def test_what_no_free_form_takes_away_is_not_said_to_lie_where_one_does(chi_squared: float, said: str) -> None:
    where = Location("spring", "leaf", ("y",), (0.0, 1.0), (80.0, 81.0), (), "")
    assert remainder_statement("Eq. 9", 0.005, chi_squared, 0.002, where) == said


@pytest.mark.parametrize(("share", "said"), [(1.0, "100 %"), (0.976, "98 %"), (0.031, "3.1 %")])
def test_a_share_is_said_in_plain_numbers(share: float, said: str) -> None:
    where = Location("spring", "leaf", ("y",), (0.0, 1.0), (80.0, 81.0), (), "")
    assert f", {said} of what the rig misses" in remainder_statement("the rig", share, 52.0, 3.6e-8, where)
