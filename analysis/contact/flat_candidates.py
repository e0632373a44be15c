"""Explanations of the contact stiffness of rough flats."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.contact.changes import (
    Law,
    Number,
    Priors,
    in_series,
    others,
    power_laws,
    theory,
    with_change,
    with_changes,
)
from analysis.contact.elastic_plastic import ElasticPlasticFlats
from analysis.contact.exponential import LAMBDA
from analysis.contact.tabulated import gaussian_flats, rough_sphere, yielding_flats
from analysis.contact.theory import Surfaces
from analysis.contact.weighing import Candidate, Parameter

FloatArray = NDArray[np.float64]


class Flats:
    """Laws k_c(P) of a pair of flats, for arrays (g, 1) of a factor on R_q and of what else is unknown."""

    def __init__(self, s: Surfaces):
        self.s, self.A_n = s, float(s.A_n or math.nan)
        # a rigid punch of the nominal area, MN/m
        self.patch_spring = 2 * s.E_star * math.sqrt(self.A_n / math.pi) * 1e-6

    def elastic(self, factor: FloatArray, share: Number = 1.0) -> Law:
        """Eq. 5, over a share of the nominal area."""
        R_q, carried = self._carried(factor, share)
        return lambda P: carried / R_q * gaussian_flats()(P / carried)

    def exponential(self, factor: FloatArray) -> Law:
        """Eq. 8."""
        return lambda P: LAMBDA * P / (self.s.R_q * factor)

    def yielding(self, factor: FloatArray, H_gpa: Number | None = None) -> Law:
        """Eq. 6: the slope of first loading."""
        return self._yielding(factor, H_gpa, 1.0, unloading=False)

    def unloading(self, factor: FloatArray, H_gpa: Number | None = None, share: Number = 1.0) -> Law:
        """Elastic unloading of the spots of Eq. 6, over a share of the nominal area."""
        return self._yielding(factor, H_gpa, share, unloading=True)

    def partial_contact(self, factor: FloatArray, share: FloatArray) -> Law:
        """Eq. 5 over a share of the nominal area, which the bodies give way under."""
        return in_series(self.elastic(factor, share), self.patch_spring * np.sqrt(share))

    def crowned(self, factor: FloatArray, R: FloatArray) -> Law:
        """Flats rounded to the radius R, m."""
        return rough_sphere(self.s, R, factor)

    def _carried(self, factor: FloatArray, share: Number) -> tuple[FloatArray, FloatArray]:
        s, R_q = self.s, self.s.R_q * factor
        return R_q, 4 / 3 * s.eta * self.A_n * share * s.E_star * math.sqrt(s.R_s) * R_q**1.5

    def _yielding(self, factor: FloatArray, H_gpa: Number | None, share: Number, unloading: bool) -> Law:
        s = self.s
        unit = ElasticPlasticFlats(s.eta, self.A_n, s.E_star, s.R_s, s.R_q, 1e9, s.nu).critical_interference
        omega_c = unit * np.square(s.H * 1e-9 if H_gpa is None else H_gpa) / factor
        R_q, carried = self._carried(factor, share)
        return lambda P: carried / R_q * yielding_flats(omega_c, P / carried, unloading)


def flat_candidates(s: Surfaces, priors: Priors, other_assembly: Sequence[float]) -> list[Candidate]:
    """Return the explanations for flats; loads, N, of another assembly, which is misaligned by itself, if at all."""
    flats, uncertain = Flats(s), priors.of_flats
    # so far apart are the rims of a crown that asperities at the edge of A_n still touch
    largest_radius = flats.A_n / (6 * math.pi * s.R_q)
    crown = Parameter("R", "m", min(1e-3, largest_radius / 10), largest_radius)
    hardness, roughness = "asperities of another hardness H", "Eq. 5; a roughness other than measured"
    seen = "yielded asperities, in elastic unloading"
    mass = next(change for change in others(priors) if change.id == "moving_mass")
    at_half = float(flats.elastic(np.ones((1, 1)))(np.array([0.5]))[0, 0]) * 1e-6

    def rougher(one: FloatArray, f: FloatArray) -> Law:
        return flats.elastic(f * one)

    def unloading_share(factor: FloatArray, share: FloatArray) -> Law:
        return flats.unloading(factor, None, share)

    return [
        theory("elastic_asperities", "asperities of Gaussian heights, elastic (Eq. 5)", flats.elastic, uncertain),
        theory("exponential_heights", "asperities of exponential heights (Eq. 7, 8)", flats.exponential, uncertain),
        theory(
            "yielding_asperities",
            "asperities of Gaussian heights that yield at the stated hardness, in first loading (Eq. 6)",
            flats.yielding,
            uncertain,
        ),
        theory(
            "bulk",
            "Eq. 5; bodies that give way under the whole nominal area",
            lambda f: in_series(flats.elastic(f), flats.patch_spring),
            uncertain,
        ),
        Candidate("roughness", roughness, (priors.roughness,), lambda P, f: flats.elastic(f)(P)),
        theory("plasticity", f"Eq. 6; {hardness}, in first loading", flats.yielding, uncertain, priors.hardness),
        _misaligned(flats, priors, other_assembly),
        theory(
            "crowned_flats",
            "flats rounded to the radius R: a rough sphere (Greenwood and Tripp)",
            flats.crowned,
            uncertain,
            crown,
        ),
        *with_changes(
            "Eq. 5",
            flats.elastic,
            uncertain,
            priors,
            [
                ("plasticity", f"Eq. 6; {hardness}, in first loading", flats.yielding, (priors.hardness,)),
                ("roughness", roughness, rougher, (priors.roughness,)),
                ("unloading", f"{seen}, at the stated hardness", flats.unloading, ()),
                ("unloading_hardness", f"{seen}; {hardness}", flats.unloading, (priors.hardness,)),
            ],
        ),
        with_change("roughness", roughness, rougher, (priors.roughness,), mass, uncertain, priors),
        theory("unloading", f"{seen}, at the stated hardness", flats.unloading, uncertain),
        theory("unloading_hardness", f"{seen}; {hardness}", flats.unloading, uncertain, priors.hardness),
        theory("unloading_share", f"{seen}; only a part of the area meets", unloading_share, uncertain, priors.share),
        Candidate(
            "unloading_roughness",
            f"{seen}; a roughness other than measured",
            (priors.roughness,),
            lambda P, f: flats.unloading(f)(P),
        ),
        *power_laws(priors, at_half),
    ]


def _misaligned(flats: Flats, priors: Priors, other_assembly: Sequence[float]) -> Candidate:
    """Return flats of which only a part meets; how much of it, each assembly has by itself."""
    statement = "Eq. 5; only a part of the nominal area meets, and the bodies give way under it"
    own = (priors.share,)
    if not len(other_assembly):
        return theory("misalignment", statement, flats.partial_contact, priors.of_flats, *own)
    second = Parameter("share in Fig. 6", "", priors.share.low, priors.share.high)

    def predict(P: FloatArray, share: FloatArray, other: FloatArray, factor: FloatArray) -> FloatArray:
        first, again = (flats.partial_contact(factor, x)(P) for x in (share, other))
        return np.where(np.isin(P, other_assembly), again, first)

    return Candidate(
        "misalignment", f"{statement}, in each assembly by itself", (*own, second, priors.of_flats), predict
    )
