"""The two gaps that the paper leaves between its stiffnesses and theory (Fig. 7a, 8a), and what may fill them.

The flats fall below theory at high load, the sphere lies between smooth and rough Hertz. Tables 3 and 5 go through
Eq. 11, for the flats also the two points of another assembly that Fig. 6 has, and every explanation of `candidates` is
weighed against them, under several lists and priors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from analysis.contact.candidates import stiffness_candidates
from analysis.contact.changes import REVIEWED, WIDE
from analysis.contact.inversion import TheoryError
from analysis.contact.lists import UnderList, in_first_list, spring_sentence, under_lists
from analysis.contact.presets import published_numbers
from analysis.contact.theory import TheoryCurve, surfaces_of, theory
from analysis.contact.weighing import Known, Weighed, percent, weigh, what_is_missed
from analysis.stiffness import contact_stiffness, springs_from_system_mode

FloatArray = NDArray[np.float64]
WHICH: dict[str, tuple[int, str]] = {"flat": (5, "Eq. 5"), "sphere": (3, "Eq. 3")}  # table, and the law drawn beside it
VARIATION, TAPS = 0.026, 8  # Sec. 4.1: stiffness of the eight taps of a load varies by less than this
FIG_6 = "Fig. 6"


@dataclass(frozen=True, slots=True)
class PublishedGap:
    """A gap and its explanations.

    Attributes
    ----------
    which, table
        ``flat`` or ``sphere``; number of the table.
    load_mn, f2_hz, stiffness_n_per_m
        (n,) each, by load: as published, and through Eq. 11.
    place
        Where each point stands: the table, or Fig. 6 (another assembly).
    drawn
        The theory that the paper draws beside the points.
    before
        (n,) log of measured over that theory, which nothing was fitted to.
    weighed
        Explanations under the reviewed priors, most probable first.
    lists
        What several lists of explanations and priors say of a spring in series.
    """

    which: str
    table: int
    load_mn: FloatArray
    f2_hz: FloatArray
    stiffness_n_per_m: FloatArray
    place: tuple[str, ...]
    drawn: TheoryCurve
    before: FloatArray
    weighed: tuple[Weighed, ...]
    lists: tuple[UnderList, ...]

    @property
    def before_rms(self) -> float:
        """Root mean square of ``before``."""
        return float(np.sqrt(np.mean(self.before**2)))

    @property
    def in_table(self) -> NDArray[np.bool_]:
        """(n,) whether a point stands in the table."""
        return np.array([place != FIG_6 for place in self.place])

    def other_assembly(self) -> str:
        """Say how the points of Fig. 6 compare with the table; empty without any."""
        table, other = self.in_table, ~self.in_table
        if not other.any():
            return ""
        load, k = np.log(self.load_mn), np.log(self.stiffness_n_per_m)
        off = 100 * np.expm1(k[other] - np.interp(load[other], load[table], k[table]))
        pairs = zip(self.load_mn[other], self.stiffness_n_per_m[other], strict=True)
        points = " and ".join(f"{k_c * 1e-6:.2f} MN/m at {P:g} mN" for P, k_c in pairs)
        return (
            f"Another assembly of such flats (Fig. 6) gave {points}, {off[0]:+.1f} and {off[1]:+.1f} % from Table "
            f"{self.table} there: an area that meets by chance of the alignment would differ by more."
        )

    def sentences(self) -> list[str]:
        """Say what came out."""
        best = self.weighed[0]
        alike = [w for w in self.weighed if w.candidate.id in best.indistinguishable_from]
        said = [
            f"Theory as drawn in the paper ({self.drawn.name}, {self.drawn.equation}) misses the measured stiffness by "
            f"{percent(self.before_rms)} (root mean square).",
            f"Most probable of {len(self.weighed)} explanations, at {percent(best.probability)}: "
            f"{best.candidate.statement}; each load predicted from the others is then missed by "
            f"{percent(best.left_out_rms)}"
            + (
                f", by {percent(best.left_out_rms_together)} at the loads that do not stand apart"
                if (best.apart > 0.5).any()
                else ""
            )
            + ".",
        ]
        if alike:
            said.append(
                f"These {len(self.load_mn)} points do not tell it from "
                + "; ".join(f"{_named(w.candidate.id)} ({percent(w.probability)})" for w in alike)
                + "."
            )
        said.append(spring_sentence(self.lists))
        said += [self.other_assembly()] if self.other_assembly() else []
        said.append(what_is_missed(best, self.load_mn * 1e-3, VARIATION / math.sqrt(TAPS)))
        return said

    def as_json(self) -> dict[str, Any]:
        """Return the JSON types of the format ``mesotap-published-gap``, version 1."""
        return {
            "format": "mesotap-published-gap",
            "version": 1,
            "which": self.which,
            "table": self.table,
            "load_mn": self.load_mn.tolist(),
            "place": list(self.place),
            "f2_hz": self.f2_hz.tolist(),
            "contact_stiffness_n_per_m": self.stiffness_n_per_m.tolist(),
            "drawn": {
                "name": self.drawn.name,
                "equation": self.drawn.equation,
                "contact_stiffness_n_per_m": self.drawn.stiffness(self.load_mn * 1e-3).tolist(),
                "rms_log_error": self.before_rms,
            },
            "explanations": [weighed_json(w) for w in self.weighed],
            "lists": [under.as_json() for under in self.lists],
            "sentences": self.sentences(),
        }


def weighed_json(w: Weighed) -> dict[str, Any]:
    """Return a weighed explanation as JSON types."""
    return {
        "id": w.candidate.id,
        "statement": w.candidate.statement,
        "probability": w.probability,
        "log_evidence": w.log_evidence,
        "aicc": w.aicc if math.isfinite(w.aicc) else None,
        "parameters": {p.parameter.name: _known_json(p) for p in w.parameters},
        "scatter": _known_json(w.scatter),
        "prediction": w.prediction.tolist(),
        "log_residual": w.residual.tolist(),
        "stands_apart": w.apart.tolist(),
        "left_out_log_error": w.left_out_error.tolist(),
        "left_out_rms_log_error": w.left_out_rms,
        "left_out_log_density": w.left_out_log_density,
        "indistinguishable_from": list(w.indistinguishable_from),
    }


def diagnose_published(which: str) -> PublishedGap:
    """Weigh explanations of the published stiffnesses of the ``flat`` samples (Table 5) or the ``sphere`` (Table 3)."""
    if which not in WHICH:
        raise TheoryError(f"no published measurement is called {which!r}; there are {' and '.join(WHICH)}")
    number, equation = WHICH[which]
    numbers = published_numbers()
    table, masses = numbers["tables"][number], numbers["masses"]
    preset: Literal["paper-flat", "paper-sphere"] = table["preset"]
    masses_kg = masses["m1_kg"], masses["m2_kg"]
    points = [_Points.of(f"Table {number}", table, masses_kg, 0.5, 0.05)]
    if which == "flat":
        points.append(_Points.of(FIG_6, numbers["quoted"]["spectra"], masses_kg, 5.0, 5.0))
    load_mn, f2_hz, stiffness, error = (
        np.concatenate([getattr(p, name) for p in points]) for name in ("load_mn", "f2_hz", "stiffness", "error")
    )
    place = np.concatenate([[p.place] * len(p.load_mn) for p in points])
    by_load = np.argsort(load_mn)
    load, k = load_mn[by_load] * 1e-3, stiffness[by_load]
    other = load[place[by_load] == FIG_6]
    drawn = next(curve for curve in theory(preset) if curve.equation == equation)
    surfaces = surfaces_of(preset)
    first = [c for c in stiffness_candidates(surfaces, WIDE, other) if in_first_list(c.id)]
    reviewed = weigh(load, k, error[by_load], stiffness_candidates(surfaces, REVIEWED, other))
    return PublishedGap(
        which=which,
        table=number,
        load_mn=load_mn[by_load],
        f2_hz=f2_hz[by_load],
        stiffness_n_per_m=k,
        place=tuple(str(p) for p in place[by_load]),
        drawn=drawn,
        before=np.log(k / drawn.stiffness(load)),
        weighed=tuple(reviewed),
        lists=under_lists(weigh(load, k, error[by_load], first), reviewed),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Points of one assembly, (n,) each: published, through Eq. 11, and the relative error that rounding makes."""

    place: str
    load_mn: FloatArray
    f2_hz: FloatArray
    stiffness: FloatArray
    error: FloatArray

    @classmethod
    def of(
        cls, place: str, given: dict[str, Any], masses_kg: tuple[float, float], half_hz: float, half_mn: float
    ) -> _Points:
        """Return the points of a table or a quoted figure; half a digit of what they are rounded to, Hz and mN."""
        load_mn, f2_hz = (np.array(given[key], dtype=np.float64) for key in ("load_mn", "f2_hz"))
        k1, k2 = springs_from_system_mode(given["system_resonance_hz"], math.inf, *masses_kg)
        stiffness = contact_stiffness(f2_hz, *masses_kg, k1, k2)
        more = contact_stiffness(f2_hz + half_hz / math.sqrt(3), *masses_kg, k1, k2)
        return cls(place, load_mn, f2_hz, stiffness, np.hypot(more / stiffness - 1, half_mn / math.sqrt(3) / load_mn))


def _known_json(known: Known) -> dict[str, Any]:
    return {
        "value": known.value,
        "low": known.low,
        "high": known.high,
        "unit": known.parameter.unit,
        "bounded_by_prior": known.open_below or known.open_above,
        "prior": [known.parameter.low, known.parameter.high],
    }


def _named(name: str) -> str:
    return name.replace("_", " ").replace("+", " with ")
