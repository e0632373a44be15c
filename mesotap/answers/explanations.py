"""Explanations of what was measured against load, in words: parameters, probabilities, what the best still misses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.contact.candidates import damping_candidates, stiffness_candidates
from analysis.contact.gap import weighed_json
from analysis.contact.lists import UnderList, spring_sentence, under_lists
from analysis.contact.theory import surfaces_of
from analysis.contact.weighing import Known, Weighed, percent, weigh, what_is_missed
from analysis.results import SessionResults
from analysis.settings import FlatContact, SphereContact
from calibration.estimate import Estimate
from daq.records import RigDescription

N_PER_MN = 1e-3  # newtons in a millinewton
FEWEST_LOADS = 4  # from which on explanations are weighed
LARGEST_DAMPING_SCATTER = 1.0  # relative; damping scatters more than stiffness
SHOWN = 8  # explanations in a table

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Explained:
    """k_c(P) and zeta_c(P) of a session compared with every explanation.

    Attributes
    ----------
    load_mn, stiffness_n_per_m, half_width_n_per_m
        (n,) of the loads that were used: load, contact stiffness and half of its 95 % interval.
    stiffness, damping
        Explanations, most probable first; damping empty where it is not known at every load.
    sentences
        What came out.
    lists
        What several lists of explanations say of a spring in series.
    """

    load_mn: FloatArray
    stiffness_n_per_m: FloatArray
    half_width_n_per_m: FloatArray
    stiffness: tuple[Weighed, ...]
    damping: tuple[Weighed, ...]
    sentences: tuple[str, ...]
    lists: tuple[UnderList, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the JSON types of the format ``mesotap-explanations``, version 1."""
        return {
            "format": "mesotap-explanations",
            "version": 1,
            "load_mn": self.load_mn.tolist(),
            "contact_stiffness": [weighed_json(w) for w in self.stiffness],
            "damping_ratio": [weighed_json(w) for w in self.damping],
            "lists": [under.as_json() for under in self.lists],
            "sentences": list(self.sentences),
        }


def explain(results: SessionResults, contact: SphereContact | FlatContact, rig: RigDescription) -> Explained | None:
    """Weigh all explanations of a session's stiffness and damping; None for fewer than four different loads.

    The errors of stiffness, or damping, and of the load count as independent from load to load; what masses and
    springs have in common moves all loads together and is small.
    """
    known = [
        (P, k, load.zeta2)
        for load in results.loads
        if (P := load.load_mn) is not None
        and (k := load.contact_stiffness_n_per_m) is not None
        and min(P.value, k.value) > 0
    ]
    known.sort(key=lambda row: row[0].value)
    if len({P.value for P, _, _ in known}) < FEWEST_LOADS:
        return None
    load = np.array([P.value for P, _, _ in known]) * N_PER_MN
    load_error = np.array([P.standard_error / P.value for P, _, _ in known])
    stiffness = np.array([k.value for _, k, _ in known])
    error = np.hypot(_relative([k for _, k, _ in known]), load_error)
    of_stiffness = weigh(load, stiffness, error, stiffness_candidates(surfaces_of(contact)))
    lists = under_lists((), of_stiffness)
    sentences = [
        _best("contact stiffness", of_stiffness),
        spring_sentence(lists),
        what_is_missed(of_stiffness[0], load, _rms(error)),
    ]
    of_damping: list[Weighed] = []
    ratios = [zeta for _, _, zeta in known if zeta is not None and zeta.value > 0]
    if len(ratios) == len(known) and rig.is_tester:
        reduced = rig.m1_kg * rig.m2_kg / (rig.m1_kg + rig.m2_kg)
        zeta_error = np.hypot(_relative(ratios), load_error)
        candidates = damping_candidates(stiffness, reduced)
        of_damping = weigh(
            load, np.array([zeta.value for zeta in ratios]), zeta_error, candidates, LARGEST_DAMPING_SCATTER
        )
        sentences += [_best("damping", of_damping), what_is_missed(of_damping[0], load, _rms(zeta_error))]
    half_width = np.array([k.half_width for _, k, _ in known])
    return Explained(
        load / N_PER_MN, stiffness, half_width, tuple(of_stiffness), tuple(of_damping), tuple(sentences), lists
    )


def _relative(estimates: list[Estimate]) -> FloatArray:
    return np.array([e.standard_error / e.value for e in estimates])


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _best(what: str, weighed: list[Weighed]) -> str:
    best = weighed[0]
    alike = [name.replace("_", " ").replace("+", " with ") for name in best.indistinguishable_from]
    indistinct = f", which these loads do not distinguish from {'; '.join(alike)}" if alike else ""
    return (
        f"Most probable of {len(weighed)} explanations of the {what}, at {percent(best.probability)}: "
        f"{best.candidate.statement}{indistinct}. It predicts a load from the others to {percent(best.left_out_rms)}."
    )


def known(known: Known) -> str:
    """Write a parameter as ``name value (low to high) unit``; an end that only the prior sets carries an arrow."""
    low = f"{'‹' if known.open_below else ''}{_short(known.low)}"
    high = f"{_short(known.high)}{'›' if known.open_above else ''}"
    unit = f" {known.parameter.unit}" if known.parameter.unit else ""
    return f"{known.parameter.name} {_short(known.value)} ({low} to {high}){unit}"


def chance(weighed: Weighed) -> str:
    """Write a probability in %."""
    percent = 100 * weighed.probability
    return f"{percent:.0f}" if percent >= 10 else f"{percent:.1f}" if percent >= 0.1 else "< 0.1"


def _short(value: float) -> str:
    if value == 0:
        return "0"
    decimals = max(1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{decimals}f}" if decimals < 5 else f"{value:.2g}"
