"""Explanations of a measured k_c(P) and zeta_c(P): the theories, and what may stand between them and a measurement.

Each is a law of the load with at most two unknown numbers, beside a tolerance on the roughness that all share:
profilometer scans give R_q of the contact itself only so well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.contact import hertz
from analysis.contact.elastic_plastic import ElasticPlasticFlats
from analysis.contact.exponential import LAMBDA
from analysis.contact.swing import apparent_share
from analysis.contact.tabulated import gaussian_flats, rough_sphere, yielding_flats
from analysis.contact.theory import Surfaces
from analysis.contact.weighing import Candidate, Parameter, Prediction, tolerance

FloatArray = NDArray[np.float64]
Number = FloatArray | float
Law = Callable[[FloatArray], FloatArray]  # k_c, N/m, of loads, N

FLAT_ROUGHNESS = 0.10  # relative standard deviation of R_q from 1-mm scans
SPHERE_ROUGHNESS = 0.15  # more, for the asperities' radius and density are unknown of the sphere
LARGEST_SWING = 1.06  # N: the contact force at 1 g (Sec. 3.3) in the contact mode of the published masses

SERIES = Parameter("k_s", "MN/m", 0.3, 1000.0)
HARDNESS = Parameter("H", "GPa", 0.3, 30.0)
SHARE = Parameter("share of A_n", "", 1e-4, 1.0)
ADHESION = Parameter("P_a", "N", 0.0, 0.5, logarithmic=False)
CARRIED = Parameter("P_0", "N", 0.0, 0.5, logarithmic=False)
SWING = Parameter("F", "N", 0.0, LARGEST_SWING, logarithmic=False)
ROUGHNESS = Parameter("R_q over measured", "", 0.2, 5.0)
DENSITY = Parameter("asperity density over assumed", "", 0.1, 10.0)
COEFFICIENT = Parameter("k_c at 0.5 N", "MN/m", 0.01, 1000.0)
EXPONENT = Parameter("exponent", "", 0.0, 1.5, logarithmic=False)


@dataclass(frozen=True, slots=True)
class Change:
    """What stands between a theory and a measurement: an unknown number, and what it makes of the law k_c(P)."""

    id: str
    statement: str
    parameter: Parameter
    change: Callable[[Law, FloatArray], Law]


def in_series(k_c: Law, k_s: Number) -> Law:
    """Return k_c(P) with a spring, MN/m, in series."""
    return lambda P: 1 / (1 / k_c(P) + 1e-6 / k_s)


def _shifted(k_c: Law, P_a: FloatArray) -> Law:
    return lambda P: k_c(P + P_a)


def _carried(k_c: Law, P_0: FloatArray) -> Law:
    return lambda P: np.where(P > P_0, k_c(np.where(P > P_0, P - P_0, 1.0)), np.nan)


def swinging(k_c: Law, F: Number) -> Law:
    """Return k_c(P) as the resonance shows it while the contact force swings by +-F, N."""

    def shown(P: FloatArray) -> FloatArray:
        small = k_c(P)
        exponent = np.log(k_c(1.02 * P) / k_c(P / 1.02)) / (2 * math.log(1.02))
        return small * apparent_share(exponent, F / P)

    return shown


CHANGES = (
    Change(
        "series_compliance",
        "a spring k_s in series: holder, set screws, adhesive, body of the samples",
        SERIES,
        in_series,
    ),
    Change(
        "adhesion",
        "the asperities carry P_a more than the load read: attraction, or the zero of the gauge",
        ADHESION,
        _shifted,
    ),
    Change("carried_load", "P_0 of the load read does not pass through the contact", CARRIED, _carried),
    Change(
        "amplitude", "vibration swings the contact force by F, and the resonance shows the softer mean", SWING, swinging
    ),
)


def stiffness_candidates(surfaces: Surfaces) -> list[Candidate]:
    """Return the explanations of k_c(P), N/m, for a sphere or for flats."""
    named = _of_flats(surfaces) if surfaces.A_n is not None else _of_sphere(surfaces)
    free = Candidate(
        "power_law",
        "something else: any power of the load",
        (COEFFICIENT, EXPONENT),
        lambda P, c, e: 1e6 * c * (P / 0.5) ** e,
    )
    return [*named, free]


def damping_candidates(stiffness: FloatArray, reduced_mass: float) -> list[Candidate]:
    """Return the explanations of zeta_c(P).

    Parameters
    ----------
    stiffness
        (n,) contact stiffness, N/m, at the loads that will be weighed: a damper's ratio depends on it.
    reduced_mass
        m1 m2 / (m1 + m2), kg.
    """
    critical = 2 * np.sqrt(stiffness * reduced_mass)
    ratio = Parameter("zeta", "%", 1e-3, 100.0)
    at_half = Parameter("zeta at 0.5 N", "%", 1e-3, 100.0)
    slope = Parameter("exponent", "", -4.0, 2.0, logarithmic=False)
    falling = Parameter("power", "", 1.0, 8.0, logarithmic=False)
    c, rate = Parameter("c_c", "N s/m", 0.01, 1e4), Parameter("c_c / P", "s/m", 0.01, 1e5)
    return [
        Candidate(
            "material",
            "a loss factor of the material: the same ratio at every load",
            (ratio,),
            lambda P, z: z / 100 + 0 * P,
        ),
        Candidate(
            "viscous", "one viscous damper: c_c does not depend on the load", (c,), lambda P, c: c / critical + 0 * P
        ),
        Candidate(
            "hunt_crossley",
            "Hunt and Crossley: c_c is proportional to the load",
            (rate,),
            lambda P, a: a * P / critical,
        ),
        Candidate("slip", "slip held down by the load: a ratio as 1 / P", (at_half,), lambda P, z: z / 100 * 0.5 / P),
        Candidate(
            "slip_and_material",
            "slip, as 1 / P, beside a loss factor",
            (ratio, at_half),
            lambda P, m, z: (m + z * 0.5 / P) / 100,
        ),
        Candidate(
            "falling_and_material",
            "a loss factor beside a part that falls as a power of the load",
            (ratio, at_half, falling),
            lambda P, m, z, n: (m + z * (0.5 / P) ** n) / 100,
        ),
        Candidate(
            "power_law",
            "something else: any power of the load",
            (at_half, slope),
            lambda P, z, n: z / 100 * (P / 0.5) ** n,
        ),
    ]


def _changed(base: Callable[..., Law], own: Sequence[Parameter], changes: Sequence[Change]) -> Prediction:
    """y(P, own parameters, changes' parameters, roughness factor); changes act in their order."""

    def predict(P: FloatArray, *values: FloatArray) -> FloatArray:
        law = base(values[-1], *values[: len(own)])
        for change, value in zip(changes, values[len(own) : -1], strict=True):
            law = change.change(law, value)
        return law(P)

    return predict


def _with_changes(
    theory: str,
    base: Callable[..., Law],
    uncertain: Parameter,
    pairs: Sequence[tuple[str, str, Callable[..., Law], Sequence[Parameter]]],
) -> list[Candidate]:
    """A theory with each change, and with a spring in series beside each other one and each of ``pairs``."""
    series, *others = CHANGES
    found = []
    for change in CHANGES:
        predict = _changed(base, (), (change,))
        found.append(Candidate(change.id, f"{theory}; {change.statement}", (change.parameter, uncertain), predict))
    for change in others:
        predict = _changed(base, (), (change, series))
        found.append(
            Candidate(
                f"{change.id}+{series.id}",
                f"{theory}; {change.statement}; {series.statement}",
                (change.parameter, series.parameter, uncertain),
                predict,
            )
        )
    for name, statement, law, own in pairs:
        predict = _changed(law, own, (series,))
        known = () if ROUGHNESS in own else (uncertain,)
        if not known:
            predict = _without_tolerance(predict)
        found.append(
            Candidate(
                f"{name}+{series.id}", f"{statement}; {series.statement}", (*own, series.parameter, *known), predict
            )
        )
    return found


def _without_tolerance(predict: Prediction) -> Prediction:
    return lambda P, *values: predict(P, *values, np.ones((1, 1)))


# Flats


def _of_flats(s: Surfaces) -> list[Candidate]:
    A_n = float(s.A_n or math.nan)
    uncertain = tolerance("R_q over measured", FLAT_ROUGHNESS)
    patch_spring = 2 * s.E_star * math.sqrt(A_n / math.pi) * 1e-6  # a rigid punch of the nominal area, MN/m
    # so far apart are the rims of a crown that asperities at the edge of A_n still touch
    largest_radius = A_n / (6 * math.pi * s.R_q)
    crown = Parameter("R", "m", min(1e-3, largest_radius / 10), largest_radius)

    def elastic(factor: FloatArray, share: Number = 1.0) -> Law:
        R_q = s.R_q * factor
        carried = 4 / 3 * s.eta * A_n * share * s.E_star * math.sqrt(s.R_s) * R_q**1.5
        return lambda P: carried / R_q * gaussian_flats()(P / carried)

    def exponential(factor: FloatArray) -> Law:
        return lambda P: LAMBDA * P / (s.R_q * factor)

    def yielding(factor: FloatArray, H_gpa: Number = s.H * 1e-9) -> Law:
        R_q = s.R_q * factor
        unit = ElasticPlasticFlats(s.eta, A_n, s.E_star, s.R_s, s.R_q, 1e9, s.nu).critical_interference
        omega_c = unit * np.square(H_gpa) / factor
        carried = 4 / 3 * s.eta * A_n * s.E_star * math.sqrt(s.R_s) * R_q**1.5
        return lambda P: carried / R_q * yielding_flats(omega_c, P / carried)

    def partial_contact(factor: FloatArray, share: FloatArray) -> Law:
        return in_series(elastic(factor, share), patch_spring * np.sqrt(share))

    def crowned(factor: FloatArray, R: FloatArray) -> Law:
        return rough_sphere(s, R, factor)

    return [
        _theory("elastic_asperities", "asperities of Gaussian heights, elastic (Eq. 5)", elastic, uncertain),
        _theory("exponential_heights", "asperities of exponential heights (Eq. 7, 8)", exponential, uncertain),
        _theory(
            "yielding_asperities",
            "asperities of Gaussian heights that yield at the stated hardness (Eq. 6)",
            yielding,
            uncertain,
        ),
        _theory(
            "bulk",
            "Eq. 5; bodies that give way under the whole nominal area",
            lambda f: in_series(elastic(f), patch_spring),
            uncertain,
        ),
        Candidate("roughness", "Eq. 5; a roughness other than measured", (ROUGHNESS,), lambda P, f: elastic(f)(P)),
        _theory("plasticity", "Eq. 6; asperities of another hardness H", yielding, uncertain, HARDNESS),
        _theory(
            "misalignment",
            "Eq. 5; only a part of the nominal area meets, and the bodies give way under it",
            partial_contact,
            uncertain,
            SHARE,
        ),
        _theory(
            "crowned_flats",
            "flats rounded to the radius R: a rough sphere (Greenwood and Tripp)",
            crowned,
            uncertain,
            crown,
        ),
        *_with_changes(
            "Eq. 5",
            elastic,
            uncertain,
            [
                ("plasticity", "Eq. 6; asperities of another hardness H", yielding, (HARDNESS,)),
                ("roughness", "Eq. 5; a roughness other than measured", lambda one, f: elastic(f * one), (ROUGHNESS,)),
            ],
        ),
    ]


def _theory(name: str, statement: str, law: Callable[..., Law], uncertain: Parameter, *own: Parameter) -> Candidate:
    return Candidate(name, statement, (*own, uncertain), _changed(law, own, ()))


# Sphere


def _of_sphere(s: Surfaces) -> list[Candidate]:
    R = float(s.R or math.nan)
    uncertain = tolerance("R_q over measured", SPHERE_ROUGHNESS)

    def smooth(P: FloatArray) -> FloatArray:
        return hertz.stiffness(P, R, s.E_star)

    def rough(factor: FloatArray) -> Law:
        return rough_sphere(s, R, factor)

    def yielding(factor: FloatArray) -> Law:
        return rough_sphere(s, R, factor, s.H)

    def other_density(factor: FloatArray, density: FloatArray) -> Law:
        return rough_sphere(s, R, factor, density=density)

    GT = "rough sphere (Greenwood and Tripp)"
    series = CHANGES[0]
    return [
        Candidate("hertz", "smooth sphere (Eq. 2)", (), lambda P: smooth(P)[None]),
        Candidate("third_of_hertz", "a third of Hertz's stiffness (Eq. 3)", (), lambda P: smooth(P)[None] / 3),
        _theory("rough_sphere", GT, rough, uncertain),
        _theory("yielding_asperities", f"{GT} whose asperities yield at the stated hardness", yielding, uncertain),
        Candidate("roughness", f"{GT}; a roughness other than measured", (ROUGHNESS,), lambda P, f: rough(f)(P)),
        _theory("asperities", f"{GT}; another density of asperities", other_density, uncertain, DENSITY),
        Candidate(
            "smooth+series_compliance",
            f"smooth sphere (Eq. 2); {series.statement}",
            (SERIES,),
            lambda P, k_s: in_series(smooth, k_s)(P),
        ),
        *_with_changes(
            GT,
            rough,
            uncertain,
            [
                ("yielding_asperities", f"{GT} whose asperities yield at the stated hardness", yielding, ()),
                ("roughness", f"{GT}; a roughness other than measured", lambda one, f: rough(f * one), (ROUGHNESS,)),
                ("asperities", f"{GT}; another density of asperities", other_density, (DENSITY,)),
            ],
        ),
    ]
