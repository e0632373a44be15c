"""Lines of the mains that are tried, and how they are said."""

from __future__ import annotations

from dataclasses import replace

from sim_backend.adopted import ANY_SCALE
from sim_backend.mechanisms.mains_hum import MECHANISM


def test_no_line_is_tried_beyond_what_the_channels_show() -> None:
    slow = MECHANISM.trials(replace(ANY_SCALE, shown_hz=250.0))
    highest = {values["mains_hz"]: 0.0 for values in slow}
    for values in slow:
        highest[values["mains_hz"]] = max(highest[values["mains_hz"]], *MECHANISM.lines(values))
    assert highest == {50.0: 250.0, 60.0: 180.0}
    assert max(max(MECHANISM.lines(v)) for v in MECHANISM.trials(ANY_SCALE)) == 540.0


def test_a_few_lines_are_named_and_many_by_their_range() -> None:
    said = [MECHANISM.statement({"mains_hz": 50.0, "lines": n, "amplitude_m_s2": 0.002}, "") for n in (16.0, 12345.0)]
    assert said == [
        "The mains hums in the records: 50 and 300 Hz, the loudest line with 2 mm/s2.",
        "The mains hums in the records: 50 Hz and some of its multiples up to 250 Hz, the loudest line with 2 mm/s2.",
    ]
