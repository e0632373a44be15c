"""Between what the quantities of a recording are believed: what lies outside was made up, or is damage.

Products and ratios of what lies inside are numbers too. The bounds are far beyond any tester, and beyond what other
programs record: nothing that was measured is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Bound:
    """Magnitudes from ``least`` to ``most``, in ``unit``, and why there is nothing ``below`` and ``beyond``."""

    least: float
    most: float
    unit: str
    below: str
    beyond: str

    def fault(self, value: float) -> str:
        """Return what is wrong with a value; empty if nothing is, or if it is zero or unknown (NaN)."""
        if not value or math.isnan(value) or self.least <= abs(value) <= self.most:
            return ""
        if abs(value) > self.most:
            return f"is {value:g} {self.unit}, expected at most {self.most:g} ({self.beyond})"
        return f"is {value:g} {self.unit}, expected at least {self.least:g} ({self.below})"

    def fault_of_all(self, values: NDArray[np.float64]) -> str:
        """Return what is wrong with the largest of finite values; empty if nothing is."""
        largest = max(float(values.max(initial=0.0)), -float(values.min(initial=0.0)))
        return f"reaches {fault.removeprefix('is ')}" if (fault := self.fault(largest)) else ""


COUNTS = "they may be raw counts, scaled twice, or numbers read with the wrong type or byte order"
"""What numbers may be that are larger than any sensor's."""

MASS = Bound(1e-9, 1e6, "kg", "a grain of dust", "a ship")
STIFFNESS = Bound(1e-6, 1e15, "N/m", "softer than a cobweb", "stiffer than rock")
RATE = Bound(1e-6, 1e11, "Hz", "a sample in eleven days", "the fastest recorder")
CORNER = Bound(1e-9, 1e12, "Hz", "a drift of decades", "beyond all electronics")
ACCELERATION = Bound(
    1e-30, 1e15, "m/s2", "far below thermal noise", f"far beyond any sensor; usual is 0.0001 to 1e+06 m/s2: {COUNTS}"
)
LOAD = Bound(0.0, 1e12, "mN", "nothing", "the weight of a hundred thousand tonnes")
VOLTAGE = Bound(0.0, 1e9, "mV", "nothing", "a million volts")
FORCE = Bound(1e-30, 1e12, "N", "far below thermal noise", f"a mountain's weight; usual is 1e-06 to 1e+07 N: {COUNTS}")
ANY = Bound(1e-30, 1e30, "of its unit", "no sensor gives this; scale it", "no sensor gives this; scale it")
"""Of a recording by another program, in whatever unit."""

BOUNDS = {
    "m1_kg": MASS,
    "m2_kg": MASS,
    "tube_added_kg": MASS,
    "tube_mode_kg": MASS,
    "tube_mode_hz": CORNER,
    "k1_n_per_m": STIFFNESS,
    "k2_n_per_m": STIFFNESS,
    "sample_rate_hz": RATE,
    "highpass_hz": CORNER,
    "lowpass_hz": CORNER,
    "full_scale_m_s2": ACCELERATION,
    "target_load_mn": LOAD,
    "load_before_mn": LOAD,
    "load_after_mn": LOAD,
    "voltage_before_mv": VOLTAGE,
    "voltage_after_mv": VOLTAGE,
    "acceleration": ACCELERATION,
    "strain_mv": VOLTAGE,
    "force": FORCE,
    "channels": ANY,
    "load_mn": LOAD,
    "voltage_mv": VOLTAGE,
}
"""By the names that the items of a session file have."""

LONGEST_CALIBRATION_S = 172_800.0  # two days, as long as a test may last


def elapsed_fault(elapsed_s: NDArray[np.float64], readings: int) -> str:
    """Return what is wrong with the times of a calibration's readings since the first, s; empty if nothing is."""
    if elapsed_s.shape != (readings,):
        return f"has {elapsed_s.size} values for {readings} readings"
    if not np.isfinite(elapsed_s).all() or elapsed_s[0] < 0 or bool(np.any(np.diff(elapsed_s) < 0)):
        return "does not count seconds onwards from the first reading"
    if elapsed_s[-1] > LONGEST_CALIBRATION_S:
        return f"reaches {elapsed_s[-1]:g} s, expected at most {LONGEST_CALIBRATION_S:g} (two days)"
    return ""
