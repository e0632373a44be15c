"""The published measurements analysed again: Tables 3 and 5 through Eq. 11, beside theory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.contact.presets import published_numbers
from analysis.contact.theory import Plasticity, plasticity, theory
from analysis.stiffness import contact_stiffness, springs_from_system_mode
from rig.tube import Tube

FloatArray = NDArray[np.float64]
TUBE_DENSITY = 7900.0  # kg/m3, of stainless steels (7700 to 8000); the paper gives none


@dataclass(frozen=True, slots=True)
class WithTubes:
    """The same table with the inertia of the tube springs (Sec. 3.1) in Eq. 9.

    Attributes
    ----------
    tube_kg
        Mass of a tube spring.
    added_kg, added_at_f2_kg
        What of it moves with each block at the system resonance, and at each contact resonance, (n,).
    k1_n_per_m
        Tube springs from the system resonance; equal.
    by_geometry_n_per_m, by_geometry_hz
        Stiffness that the tubes have by their dimensions, in plane strain, and the system resonance that it makes.
    own_mode_hz
        First mode of the tubes themselves, the blocks held.
    contact_stiffness_n_per_m
        (n,) by Eq. 11.
    """

    tube_kg: float
    added_kg: float
    added_at_f2_kg: FloatArray
    k1_n_per_m: float
    by_geometry_n_per_m: float
    by_geometry_hz: float
    own_mode_hz: float
    contact_stiffness_n_per_m: FloatArray


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
    with_tubes
        What changes if the tube springs are not massless; all else is Eq. 9 as published.
    plasticity
        How far the contact's asperities yield.
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
    with_tubes: WithTubes
    plasticity: Plasticity

    @property
    def raised_by(self) -> FloatArray:
        """(n,) relative rise of the contact stiffness by the inertia of the tube springs."""
        return self.with_tubes.contact_stiffness_n_per_m / self.contact_stiffness_n_per_m - 1

    @property
    def about_plasticity(self) -> str:
        """What the hardness of the contact means for its ring-downs."""
        return self.plasticity.sentence(self.load_mn * 1e-3)

    @property
    def about_tubes(self) -> str:
        """What the inertia of the tube springs does to this table."""
        tubes, least, most = self.with_tubes, 100 * self.raised_by.min(), 100 * self.raised_by.max()
        return (
            f"The tube springs are not massless: of the {1e3 * tubes.tube_kg:.2f} g of each (dimensions of Sec. 3.1, "
            f"{TUBE_DENSITY:g} kg/m3 assumed) {1e3 * tubes.added_kg:.2f} g move with its block at "
            f"{self.system_resonance_hz:g} Hz and {1e3 * tubes.added_at_f2_kg.max():.2f} g at the highest contact "
            f"resonance, which raises k_c by {least:.2f} to {most:.2f} %. In plane strain such tubes have "
            f"{tubes.by_geometry_n_per_m * 1e-6:.3f} MN/m and make a system resonance of {tubes.by_geometry_hz:.0f} "
            f"Hz; their own first mode is at {tubes.own_mode_hz:.0f} Hz."
        )


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
                    "plasticity_index": table.plasticity.index,
                    "with_tube_springs": {
                        "tube_mass_kg": table.with_tubes.tube_kg,
                        "added_mass_at_f1_kg": table.with_tubes.added_kg,
                        "added_mass_at_f2_kg": table.with_tubes.added_at_f2_kg.tolist(),
                        "k1_n_per_m": table.with_tubes.k1_n_per_m,
                        "k1_by_geometry_n_per_m": table.with_tubes.by_geometry_n_per_m,
                        "system_resonance_by_geometry_hz": table.with_tubes.by_geometry_hz,
                        "own_mode_hz": table.with_tubes.own_mode_hz,
                        "contact_stiffness_n_per_m": table.with_tubes.contact_stiffness_n_per_m.tolist(),
                    },
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


def published_tube() -> Tube:
    """Return the tube spring of Sec. 3.1; steel of Table 2, with a density that the paper does not give."""
    numbers = published_numbers()
    given, steel = numbers["tube_springs"], numbers["tables"][2]["bodies"][1]
    return Tube(
        steel["youngs_modulus_gpa"] * 1e9,
        steel["poisson_ratio"],
        TUBE_DENSITY,
        (given["diameter_mm"] - given["thickness_mm"]) / 2 * 1e-3,
        given["thickness_mm"] * 1e-3,
        given["length_mm"] * 1e-3,
    )


def with_tubes(f1_hz: float, f2_hz: FloatArray) -> WithTubes:
    """Return contact stiffnesses (n,) by Eq. 11 from a system and contact resonances, tube springs' inertia included.

    The tubes of Sec. 3.1 beside the blocks; at each resonance what of them moves there.
    """
    masses, tube = published_numbers()["masses"], published_tube()
    m1, m2 = masses["m1_kg"], masses["m2_kg"]
    added = tube.added_mass(f1_hz)
    k1, k2 = springs_from_system_mode(f1_hz, np.inf, m1 + added, m2 + added)
    at_f2 = np.array([tube.added_mass(f) for f in f2_hz])
    found = [contact_stiffness(f, m1 + a, m2 + a, k1, k2) for f, a in zip(f2_hz, at_f2, strict=True)]
    return WithTubes(
        tube.mass,
        added,
        at_f2,
        k1,
        tube.stiffness,
        float(np.sqrt(2 * tube.stiffness / (m1 + m2 + 2 * added)) / (2 * np.pi)),
        tube.own_mode().frequency_hz,
        np.array(found, dtype=np.float64),
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
        with_tubes=with_tubes(f1_hz, f2_hz),
        plasticity=plasticity(table["preset"], load_mn * 1e-3),
    )
