"""The two gaps that the paper leaves between its stiffnesses and theory (Fig. 7a, 8a), and what may fill them.

The flats fall below theory at high load, the sphere lies between smooth and rough Hertz. Tables 3 and 5 go through
Eq. 11, and every explanation of `candidates` is weighed against the eight points of each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from analysis.contact.candidates import stiffness_candidates
from analysis.contact.inversion import TheoryError
from analysis.contact.presets import published_numbers
from analysis.contact.theory import TheoryCurve, surfaces_of, theory
from analysis.contact.weighing import Known, Weighed, percent, weigh, what_is_missed
from analysis.stiffness import contact_stiffness, springs_from_system_mode

FloatArray = NDArray[np.float64]
WHICH: dict[str, tuple[int, str]] = {"flat": (5, "Eq. 5"), "sphere": (3, "Eq. 3")}  # table, and the law drawn beside it
VARIATION, TAPS = 0.026, 8  # Sec. 4.1: stiffness of the eight taps of a load varies by less than this
SERIES = "series_compliance"


@dataclass(frozen=True, slots=True)
class PublishedGap:
    """A gap and its explanations.

    Attributes
    ----------
    which, table
        ``flat`` or ``sphere``; number of the table.
    load_mn, f2_hz, stiffness_n_per_m
        (n,) each: as published, and through Eq. 11.
    drawn
        The theory that the paper draws beside the points.
    before
        (n,) log of measured over that theory, which nothing was fitted to.
    weighed
        Explanations, most probable first.
    """

    which: str
    table: int
    load_mn: FloatArray
    f2_hz: FloatArray
    stiffness_n_per_m: FloatArray
    drawn: TheoryCurve
    before: FloatArray
    weighed: tuple[Weighed, ...]

    @property
    def before_rms(self) -> float:
        """Root mean square of ``before``."""
        return float(np.sqrt(np.mean(self.before**2)))

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
        part = sum(w.probability for w in self.weighed if SERIES in w.candidate.id.split("+"))
        said.append(f"A spring in series takes part in explanations that hold {percent(part)} of the probability.")
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
            "f2_hz": self.f2_hz.tolist(),
            "contact_stiffness_n_per_m": self.stiffness_n_per_m.tolist(),
            "drawn": {
                "name": self.drawn.name,
                "equation": self.drawn.equation,
                "contact_stiffness_n_per_m": self.drawn.stiffness(self.load_mn * 1e-3).tolist(),
                "rms_log_error": self.before_rms,
            },
            "explanations": [weighed_json(w) for w in self.weighed],
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
    load_mn, f2_hz = (np.array(table[key], dtype=np.float64) for key in ("load_mn", "f2_hz"))
    m1, m2 = masses["m1_kg"], masses["m2_kg"]
    k1, k2 = springs_from_system_mode(table["system_resonance_hz"], math.inf, m1, m2)
    stiffness = contact_stiffness(f2_hz, m1, m2, k1, k2)
    drawn = next(curve for curve in theory(preset) if curve.equation == equation)
    half_hz, half_mn = 0.5 / math.sqrt(3), 0.05 / math.sqrt(3)  # tables are rounded to 1 Hz and 0.1 mN
    by_hz = (contact_stiffness(f2_hz + half_hz, m1, m2, k1, k2) - stiffness) / stiffness
    return PublishedGap(
        which=which,
        table=number,
        load_mn=load_mn,
        f2_hz=f2_hz,
        stiffness_n_per_m=stiffness,
        drawn=drawn,
        before=np.log(stiffness / drawn.stiffness(load_mn * 1e-3)),
        weighed=tuple(
            weigh(
                load_mn * 1e-3, stiffness, np.hypot(by_hz, half_mn / load_mn), stiffness_candidates(surfaces_of(preset))
            )
        ),
    )


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
