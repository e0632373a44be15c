"""What files of answers call themselves: for those who read them without the analysis that made them."""

from __future__ import annotations

RESULTS_FORMAT, MODES_FORMAT, VERSION = "mesotap-results", "mesotap-modes", 1
