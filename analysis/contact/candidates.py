"""Explanations of a measured k_c(P) and zeta_c(P): the theories, and what may stand between them and a measurement.

Each is a law of the load with few unknown numbers, beside what profilometer scans say of R_q, which all share.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.contact.changes import REVIEWED, Priors
from analysis.contact.flat_candidates import flat_candidates
from analysis.contact.sphere_candidates import sphere_candidates
from analysis.contact.theory import Surfaces
from analysis.contact.weighing import Candidate, Parameter

FloatArray = NDArray[np.float64]


def stiffness_candidates(
    surfaces: Surfaces, priors: Priors = REVIEWED, other_assembly: Sequence[float] = ()
) -> list[Candidate]:
    """Return the explanations of k_c(P), N/m, for a sphere or for flats.

    Parameters
    ----------
    surfaces
        The contact.
    priors
        What is known beforehand of the unknown numbers.
    other_assembly
        Loads, N, among those that will be weighed at which another assembly of the same flats was measured.
    """
    if surfaces.A_n is not None:
        return flat_candidates(surfaces, priors, other_assembly)
    return sphere_candidates(surfaces, priors)


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
