"""Values that are allowed and yet are probably written in another unit: what is usual, and what else each may be.

A bench is built once and its configuration typed once, so a mass in grams is told before it is believed. What is usual
spans the testers that are described in the literature of contact resonance with a factor of ten or more on each side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Usual:
    """What is usual of a quantity.

    Attributes
    ----------
    least, most
        Usual values lie between them, in ``unit``.
    unit
        Of the key.
    others
        Units in which people think of it, with what one of them is in ``unit``.
    """

    least: float
    most: float
    unit: str
    others: tuple[tuple[str, float], ...] = ()

    def remark(self, key: str, value: float) -> str:
        """Return what else an unusual value could mean; empty where it is usual, or would be in no unit.

        Examples
        --------
        >>> MASS.remark("rig.masses.m1_kg", 107)
        'rig.masses.m1_kg is 107 kg; usual is 0.005 to 20 kg: if 107 g is meant, write 0.107'
        """
        if not value or self._holds(value):
            return ""
        others = ((unit, value * of) for unit, of in self.others if self._holds(value * of))
        meant = " or ".join(f"if {value:g} {unit} is meant, write {written:g}" for unit, written in others)
        return (
            f"{key} is {value:g} {self.unit}; usual is {self.least:g} to {self.most:g} {self.unit}: {meant}"
            if meant
            else ""
        )

    def _holds(self, value: float) -> bool:
        return self.least <= abs(value) <= self.most


MASS = Usual(0.005, 20.0, "kg", (("g", 1e-3),))
STIFFNESS = Usual(1e3, 1e9, "N/m", (("N/mm", 1e3), ("N/um", 1e6)))
RESONANCE = Usual(10.0, 2e4, "Hz", (("kHz", 1e3),))
RATE = Usual(5e3, 5e6, "Hz", (("kHz", 1e3), ("MHz", 1e6)))
LOWPASS = Usual(500.0, 5e6, "Hz", (("kHz", 1e3),))
LOAD = Usual(5.0, 2e4, "mN", (("N", 1e3), ("uN", 1e-3)))
WEIGHT = Usual(10.0, 2e4, "mN", (("N", 1e3), ("g", 9.80665), ("uN", 1e-3)))
GAUGE = Usual(1e-4, 5.0, "mV/mN", (("mV/N", 1e-3), ("V/mN", 1e3)))
ACCELEROMETER = Usual(1.0, 5e3, "mV/g", (("mV per m/s2", 9.80665), ("V/g", 1e3)))
YOUNG = Usual(0.5, 1300.0, "GPa", (("MPa", 1e-3), ("Pa", 1e-9)))
HARDNESS = Usual(0.01, 150.0, "GPa", (("MPa", 1e-3), ("HV", 9.80665e-3), ("Pa", 1e-9)))
ROUGHNESS = Usual(1e-3, 20.0, "um", (("nm", 1e-3), ("m", 1e6)))
AREA = Usual(1e-4, 1e3, "mm2", (("um2", 1e-6), ("m2", 1e6)))

LARGEST_SHARE = 0.05
"""Of a mass, that its standard uncertainty may be before it is told: a kitchen scale weighs better."""

USUAL = {
    "rig.masses.m1_kg": MASS,
    "rig.masses.m2_kg": MASS,
    "rig.springs.k1_n_per_m": STIFFNESS,
    "rig.springs.k2_n_per_m": STIFFNESS,
    "rig.springs.system_resonance_hz": RESONANCE,
    "rig.wiring.sample_rate_hz": RATE,
    "rig.wiring.accelerometer_a.sensitivity_mv_per_g": ACCELEROMETER,
    "rig.wiring.accelerometer_b.sensitivity_mv_per_g": ACCELEROMETER,
    "rig.filter.lowpass_hz": LOWPASS,
    "rig.gauge_sensitivity_mv_per_mn": GAUGE,
    "rig.limits.load_mn": LOAD,
    "mesotap.load_plan_mn": LOAD,
    "calibration.weights_mn": WEIGHT,
    "analysis.contact.upper.youngs_modulus_gpa": YOUNG,
    "analysis.contact.lower.youngs_modulus_gpa": YOUNG,
    "analysis.contact.upper.hardness_gpa": HARDNESS,
    "analysis.contact.lower.hardness_gpa": HARDNESS,
    "analysis.contact.roughness_rq_um": ROUGHNESS,
    "analysis.contact.nominal_area_mm2": AREA,
}


def unusual(content: dict[str, Any]) -> list[str]:
    """Return a sentence for every value of a configuration that is far from usual.

    Parameters
    ----------
    content
        Sections as they were read, valid or not; what is missing or no number is passed over. Of a list the largest
        value speaks: a load plan may begin very low.
    """
    said = [_remark(content, key, usual) for key, usual in USUAL.items()]
    return [one for one in (*said, _uncertain_masses(content)) if one]


def _uncertain_masses(content: Any) -> str:
    """Say that masses are known worse than any balance weighs, and what that may mean; empty where they are not."""
    error, *masses = (_magnitude(_at(content, f"rig.masses.{key}")) for key in ("uncertainty_kg", "m1_kg", "m2_kg"))
    lightest = min((m for m in masses if m), default=0.0)
    if not lightest or error <= LARGEST_SHARE * lightest:
        return ""
    return (
        f"rig.masses.uncertainty_kg is {error:g} kg, {100 * error / lightest:.3g} % of the lighter mass; usual is at "
        f"most {100 * LARGEST_SHARE:g} %: if {error:g} g is meant, write {1e-3 * error:g}"
    )


def _at(content: Any, key: str) -> Any:
    for part in key.split("."):
        content = content.get(part) if isinstance(content, dict) else None
    return content


def _remark(content: Any, key: str, usual: Usual) -> str:
    content = _at(content, key)
    several = isinstance(content, list | tuple)
    values = [_magnitude(v) for v in (content if several else [content])]
    return usual.remark(f"the largest of {key}" if several else key, max(values, default=0.0))


def _magnitude(value: Any) -> float:
    """Return how large a number is; 0.0 for what is none, or too large for a float, which the schema refuses."""
    try:
        size = abs(float(value)) if isinstance(value, int | float) and value is not True else 0.0
    except OverflowError:
        return 0.0
    return size if math.isfinite(size) else 0.0
