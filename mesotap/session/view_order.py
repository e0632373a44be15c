"""What may be asked of the live view; no numerics, so that who only passes it on need not load any."""

from __future__ import annotations

SPANS_MS = (10, 20, 50, 100, 200, 500, 1000, 2000)
MOST_AVERAGES = 200
LARGEST_LEVEL_M_S2 = 1000.0

SIDES = {"middle": 0, "a": 1, "b": -1}
"""Where the lower mass is tapped: between the accelerometers, beside A, beside B."""
