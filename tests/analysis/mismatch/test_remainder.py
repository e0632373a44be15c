"""Where a remainder lies, and how that is said."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.mismatch.remainder import frequency_words, spread_of


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
