"""The published measurements analysed again: Tables 3 and 5 through Eq. 11, beside theory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.contact.presets import published_numbers
from analysis.contact.theory import theory
from analysis.stiffness import contact_stiffness, springs_from_system_mode

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PublishedTheory:
    """One law beside a table: its stiffness (n,), N/m, the measured over it (n,), and its log slope against load."""

    name: str
    equation: str
    stiffness_n_per_m: FloatArray
    measured_over_theory: FloatArray
    log_slope: float


@dataclass(frozen=True, slots=True)
class PublishedTable:
    """One published table, (n,) loads, and what Eq. 11 makes of it.

    Attributes
    ----------
    number
        Of the table.
    contact
        Name of the contact's preset.
    system_resonance_hz
        Behind the springs.
    k1_n_per_m, k2_n_per_m
        Tube springs from the system resonance and a stiff contact, taken as equal.
    load_mn, f2_hz, contact_stiffness_n_per_m
        (n,) each.
    log_slope
        Exponent of the power law through the stiffnesses against load.
    theories
        The laws for this contact at the same loads.
    """

    number: int
    contact: str
    system_resonance_hz: float
    k1_n_per_m: float
    k2_n_per_m: float
    load_mn: FloatArray
    f2_hz: FloatArray
    contact_stiffness_n_per_m: FloatArray
    log_slope: float
    theories: tuple[PublishedTheory, ...]


@dataclass(frozen=True, slots=True)
class Published:
    """The published measurements analysed again, and the contradictions in what was published, a sentence each."""

    tables: tuple[PublishedTable, ...]
    conflicts: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the JSON types of the format ``mesotap-published``, version 1."""
        return {
            "format": "mesotap-published",
            "version": 1,
            "tables": [
                {
                    "table": table.number,
                    "contact": table.contact,
                    "system_resonance_hz": table.system_resonance_hz,
                    "k1_n_per_m": table.k1_n_per_m,
                    "k2_n_per_m": table.k2_n_per_m,
                    "load_mn": table.load_mn.tolist(),
                    "f2_hz": table.f2_hz.tolist(),
                    "contact_stiffness_n_per_m": table.contact_stiffness_n_per_m.tolist(),
                    "log_slope": table.log_slope,
                    "theories": [
                        {
                            "name": law.name,
                            "equation": law.equation,
                            "contact_stiffness_n_per_m": law.stiffness_n_per_m.tolist(),
                            "measured_over_theory": law.measured_over_theory.tolist(),
                            "log_slope": law.log_slope,
                        }
                        for law in table.theories
                    ],
                }
                for table in self.tables
            ],
            "conflicts": list(self.conflicts),
        }


def reanalyse() -> Published:
    """Analyse Tables 5 and 3 again: k1 = k2 from the system resonance, k_c from Eq. 11, theory at the same loads."""
    numbers = published_numbers()
    return Published(
        tables=tuple(_table(number, numbers) for number in (5, 3)),
        conflicts=tuple(conflict["sentence"] for conflict in numbers["conflicts"]),
    )


def log_slope(load: FloatArray, stiffness: FloatArray) -> float:
    """Return the exponent of the power law through (n,) stiffnesses against (n,) loads, least squares of logarithms."""
    return float(np.polyfit(np.log(load), np.log(stiffness), 1)[0])


def _table(number: int, numbers: dict[str, Any]) -> PublishedTable:
    table, masses = numbers["tables"][number], numbers["masses"]
    load_mn = np.array(table["load_mn"], dtype=np.float64)
    f2_hz = np.array(table["f2_hz"], dtype=np.float64)
    f1_hz = table["system_resonance_hz"]
    m1, m2 = masses["m1_kg"], masses["m2_kg"]
    k1, k2 = springs_from_system_mode(f1_hz, np.inf, m1, m2)
    measured = contact_stiffness(f2_hz, m1, m2, k1, k2)
    laws = []
    for curve in theory(table["preset"]):
        stiffness = curve.stiffness(load_mn * 1e-3)
        laws.append(
            PublishedTheory(curve.name, curve.equation, stiffness, measured / stiffness, log_slope(load_mn, stiffness))
        )
    return PublishedTable(
        number=number,
        contact=table["preset"],
        system_resonance_hz=f1_hz,
        k1_n_per_m=k1,
        k2_n_per_m=k2,
        load_mn=load_mn,
        f2_hz=f2_hz,
        contact_stiffness_n_per_m=measured,
        log_slope=log_slope(load_mn, measured),
        theories=tuple(laws),
    )
