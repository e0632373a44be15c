"""Numbers that the paper's text quotes beside what its equations give: which come out, which not, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from analysis.contact import gaussian, hertz
from analysis.contact.elastic import plane_strain_block_stiffness
from analysis.contact.elastic_plastic import ElasticPlasticFlats
from analysis.contact.presets import published_numbers
from analysis.contact.theory import surfaces_of
from analysis.published import reanalyse

FLAT_KEYS = {"flat_rq_10_nm": 10e-9, "flat_rq_100_nm": 100e-9, "flat_rq_1_um": 1e-6}  # m


@dataclass(frozen=True, slots=True)
class Quoted:
    """A quoted number.

    Attributes
    ----------
    place, what
        Where it stands and of what it is.
    quoted
        As printed.
    unit
        Of all numbers.
    half_digit
        Half of a unit of its last printed digit: how far rounding may have moved it.
    by, computed
        Which equation, and what it gives.
    why
        What there is to say where it does not round to it; else empty.
    """

    place: str
    what: str
    quoted: float
    unit: str
    half_digit: float
    by: str
    computed: float
    why: str = ""

    @property
    def verdict(self) -> Literal["rounded", "cut off", "no"]:
        """Whether the computed number is the quoted one when rounded, or only when its further digits are cut off."""
        above = (self.computed - self.quoted) / self.half_digit
        return "rounded" if abs(above) <= 1 else "cut off" if 0 < above < 2 else "no"

    @property
    def comes_out(self) -> bool:
        """Whether it does in either way."""
        return self.verdict != "no"

    def as_json(self) -> dict[str, Any]:
        """Return the row as JSON types."""
        return {
            "place": self.place,
            "what": self.what,
            "quoted": self.quoted,
            "unit": self.unit,
            "half_digit": self.half_digit,
            "by": self.by,
            "computed": self.computed,
            "verdict": self.verdict,
            "why": self.why,
        }


def quoted_numbers() -> list[Quoted]:
    """Return every quoted number that an equation of the paper is to give, in the order of the text."""
    numbers = published_numbers()
    return [*_flats(numbers), *_spheres(numbers), _block(numbers), *_measured(numbers)]


def _flats(numbers: dict[str, Any]) -> list[Quoted]:
    theory, s = numbers["quoted"]["theory"], surfaces_of("paper-flat")
    loads = np.array(theory["load_mn"]) * 1e-3
    rows = []
    for key, R_q in FLAT_KEYS.items():
        surfaces = {"eta": s.eta, "A_n": s.A_n or np.nan, "E_star": s.E_star, "R_s": s.R_s, "R_q": R_q}
        elastic = gaussian.stiffness(loads, **surfaces) * 1e-6
        yielding = ElasticPlasticFlats(H=s.H, nu=s.nu, **surfaces).stiffness(loads) * 1e-6
        for i, load in enumerate(theory["load_mn"]):
            quoted = theory[key][i]
            what = f"rough flats, R_q {_length(R_q)}, {load:g} mN"
            why = (
                f"{elastic[i] / quoted - 1:+.0%}; with asperities that yield, Eq. 6, it is {yielding[i]:.3g} MN/m, "
                f"{yielding[i] / quoted - 1:+.0%}: no equation of the paper gives what is quoted at both loads"
            )
            row = Quoted("Sec. 2.3", what, quoted, "MN/m", _half_digit(quoted), "Eq. 5, Table 4", float(elastic[i]))
            rows.append(row if row.comes_out else _because(row, why))
    return rows


def _spheres(numbers: dict[str, Any]) -> list[Quoted]:
    theory, s = numbers["quoted"]["theory"], surfaces_of("paper-sphere")
    named = theory["hertz_radius_um"] * 1e-6
    combined = numbers["tables"][2]["combined"]["radius_um"] * 1e-6
    loads = np.array(theory["load_mn"]) * 1e-3
    rows = []
    for key, label, by, share in (
        ("hertz_smooth", "smooth sphere", "Eq. 2", 1.0),
        ("hertz_rough", "rough sphere", "Eq. 3", 3.0),
    ):
        for i, load in enumerate(theory["load_mn"]):
            at_named, at_combined = (
                float(hertz.stiffness(loads[i], R, s.E_star)) * 1e-6 / share for R in (named, combined)
            )
            row = Quoted(
                "Sec. 2.3",
                f"{label}, {load:g} mN",
                theory[key][i],
                "MN/m",
                _half_digit(theory[key][i]),
                f"{by}, combined radius of Table 2",
                at_combined,
            )
            why = f"with the radius that the text names, 0.794 mm, it is {at_named:.4g} MN/m"
            if row.quoted == 0.43:
                why += "; a third of the quoted 1.3 MN/m is 0.43 MN/m"
            rows.append(row if row.verdict == "rounded" else _because(row, why))
    return rows


def _block(numbers: dict[str, Any]) -> Quoted:
    block = numbers["quoted"]["theory"]["smooth_flat"]
    stiffness = plane_strain_block_stiffness(
        block["composite_modulus_gpa"] * 1e9,
        block["poisson_ratio"],
        block["thickness_mm"] * 1e-3,
        block["contact_radius_mm"] * 1e-3,
    )
    return Quoted(
        "Sec. 2.3",
        "smooth flat on a rigid half space",
        58.9,
        "GN/m",
        0.05,
        "Eq. 4, for each metre of length",
        stiffness * 1e-9,
    )


def _measured(numbers: dict[str, Any]) -> list[Quoted]:
    flat, sphere = reanalyse().tables
    rows = []
    quoted = numbers["quoted"]["flat_stiffness"]
    power = np.polynomial.Polynomial.fit(np.log(flat.load_mn), np.log(flat.contact_stiffness_n_per_m * 1e-6), 1)
    for load, stiffness in zip(quoted["load_mn"], quoted["contact_stiffness_n_per_um"], strict=True):
        row = Quoted(
            "Sec. 4.2.1",
            f"flats, {load:g} mN",
            stiffness,
            "MN/m",
            _half_digit(stiffness),
            "Eq. 11, power law of Table 5",
            float(np.exp(power(np.log(load)))),
        )
        rows.append(row if row.comes_out else _because(row, "outside the loads of Table 5: read off a figure"))
    conditions = numbers["quoted"]["conditions"]
    between = float(np.interp(conditions["load_mn"], flat.load_mn, flat.contact_stiffness_n_per_m)) * 1e-6
    row = Quoted(
        "Sec. 4.2.2",
        "flats, dry, 500 mN",
        conditions["dry"]["contact_stiffness_n_per_um"],
        "MN/m",
        0.005,
        "Eq. 11, between rows of Table 5",
        between,
    )
    rows.append(
        row
        if row.comes_out
        else _because(row, "another run on the same samples, perhaps: 500 mN is not a row of Table 5")
    )
    last = Quoted("Sec. 4.1", "sphere, resonance at 981 mN", 981.0, "Hz", 0.5, "Table 3", float(sphere.f2_hz[-1]))
    rows.append(_because(last, "the load's number stands in the place of the resonance's"))
    return rows


def _because(row: Quoted, why: str) -> Quoted:
    return Quoted(row.place, row.what, row.quoted, row.unit, row.half_digit, row.by, row.computed, why)


def _half_digit(number: float) -> float:
    """Half a unit of the last printed digit; zeros at the end of a whole number count up to the second digit."""
    text = f"{number:g}"
    if "." in text:
        return float(0.5 * 10.0 ** -len(text.partition(".")[2]))
    return float(0.5 * 10.0 ** (len(text) - max(len(text.rstrip("0")), min(len(text), 2))))


def _length(metres: float) -> str:
    return f"{metres * 1e9:g} nm" if metres < 1e-6 else f"{metres * 1e6:g} um"
