"""Explanations of the contact stiffness of a sphere on a flat."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from analysis.contact import hertz
from analysis.contact.changes import (
    Law,
    Priors,
    in_series,
    others,
    power_laws,
    series,
    theory,
    with_change,
    with_changes,
)
from analysis.contact.tabulated import rough_sphere
from analysis.contact.theory import Surfaces
from analysis.contact.weighing import Candidate

FloatArray = NDArray[np.float64]


def sphere_candidates(s: Surfaces, priors: Priors) -> list[Candidate]:
    """Return the explanations for a sphere."""
    R = float(s.R or math.nan)
    uncertain, spring = priors.of_sphere, series(priors)

    def smooth(P: FloatArray) -> FloatArray:
        return hertz.stiffness(P, R, s.E_star)

    def rough(factor: FloatArray) -> Law:
        return rough_sphere(s, R, factor)

    def yielding(factor: FloatArray) -> Law:
        return rough_sphere(s, R, factor, s.H)

    def unloading(factor: FloatArray) -> Law:
        return rough_sphere(s, R, factor, s.H, unloading=True)

    def rougher(one: FloatArray, f: FloatArray) -> Law:
        return rough(f * one)

    def other_density(factor: FloatArray, density: FloatArray) -> Law:
        return rough_sphere(s, R, factor, density=density)

    GT = "rough sphere (Greenwood and Tripp)"
    roughness, first = f"{GT}; a roughness other than measured", "whose asperities yield at the stated hardness"
    mass = next(change for change in others(priors) if change.id == "moving_mass")
    at_half = float(rough(np.ones((1, 1)))(np.array([0.5]))[0, 0]) * 1e-6
    return [
        Candidate("hertz", "smooth sphere (Eq. 2)", (), lambda P: smooth(P)[None]),
        Candidate("third_of_hertz", "a third of Hertz's stiffness (Eq. 3)", (), lambda P: smooth(P)[None] / 3),
        theory("rough_sphere", GT, rough, uncertain),
        theory("yielding_asperities", f"{GT} {first}, in first loading", yielding, uncertain),
        Candidate("roughness", roughness, (priors.roughness,), lambda P, f: rough(f)(P)),
        theory("asperities", f"{GT}; another density of asperities", other_density, uncertain, priors.density),
        Candidate(
            "smooth+series_compliance",
            f"smooth sphere (Eq. 2); {spring.statement}",
            (spring.parameter,),
            lambda P, k_s: in_series(smooth, k_s)(P),
        ),
        *with_changes(
            GT,
            rough,
            uncertain,
            priors,
            [
                ("yielding_asperities", f"{GT} {first}, in first loading", yielding, ()),
                ("roughness", roughness, rougher, (priors.roughness,)),
                ("asperities", f"{GT}; another density of asperities", other_density, (priors.density,)),
                ("unloading", f"{GT} {first}, in elastic unloading", unloading, ()),
            ],
        ),
        with_change("roughness", roughness, rougher, (priors.roughness,), mass, uncertain, priors),
        theory("unloading", f"{GT} {first}, in elastic unloading", unloading, uncertain),
        *power_laws(priors, at_half),
    ]
