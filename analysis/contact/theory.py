"""The theoretical contact stiffness beside a measurement: a curve for each law that suits the contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.contact import exponential, gaussian, hertz
from analysis.contact.elastic import composite_modulus
from analysis.contact.elastic_plastic import ElasticPlasticFlats
from analysis.contact.presets import resolve
from analysis.settings import FlatContact, Material, SphereContact

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TheoryCurve:
    """One law: its name, where it stands in the paper, and k_c (N/m) as a function of the load P (N, any shape)."""

    name: str
    equation: str
    stiffness: Callable[[ArrayLike], FloatArray]


def theory(contact: Literal["paper-flat", "paper-sphere"] | SphereContact | FlatContact) -> list[TheoryCurve]:
    """Return the theoretical curves for a contact.

    Sphere on flat: Hertz smooth (Eq. 2) and rough (Eq. 3). Flats: exponential asperity heights (Eq. 7, 8), Gaussian
    ones (Eq. 5), and Gaussian ones that yield (Eq. 6).
    """
    surfaces = resolve(contact)
    E_star = _modulus(surfaces.upper, surfaces.lower)
    if isinstance(surfaces, SphereContact):
        R = surfaces.radius_um * 1e-6
        return [
            TheoryCurve("Hertz, smooth", "Eq. 2", lambda P: hertz.stiffness(P, R, E_star)),
            TheoryCurve("Hertz, rough at light load", "Eq. 3", lambda P: hertz.rough_stiffness(P, R, E_star)),
        ]
    R_q = surfaces.roughness_rq_um * 1e-6
    R_s = surfaces.asperity_radius_um * 1e-6
    eta = surfaces.asperity_density_per_um2 * 1e12
    A_n = surfaces.nominal_area_mm2 * 1e-6
    softer = min(surfaces.upper, surfaces.lower, key=lambda body: body.hardness_gpa)
    yielding = ElasticPlasticFlats(eta, A_n, E_star, R_s, R_q, softer.hardness_gpa * 1e9, softer.poisson_ratio)
    return [
        TheoryCurve("rough flats, exponential heights", "Eq. 7, 8", lambda P: exponential.stiffness(P, R_q)),
        TheoryCurve(
            "rough flats, Gaussian heights", "Eq. 5", lambda P: gaussian.stiffness(P, eta, A_n, E_star, R_s, R_q)
        ),
        TheoryCurve("rough flats, Gaussian heights that yield", "Eq. 6", yielding.stiffness),
    ]


def _modulus(upper: Material, lower: Material) -> float:
    return composite_modulus(
        upper.youngs_modulus_gpa * 1e9, upper.poisson_ratio, lower.youngs_modulus_gpa * 1e9, lower.poisson_ratio
    )
