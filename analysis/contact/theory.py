"""The contact theories for a pair of surfaces: stiffness, separation or approach, and area of contact against load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.contact import exponential, gaussian, hertz
from analysis.contact.elastic import composite_modulus
from analysis.contact.elastic_plastic import ElasticPlasticFlats
from analysis.contact.presets import resolve
from analysis.contact.rough_sphere import RoughSphere
from analysis.settings import FlatContact, SphereContact

FloatArray = NDArray[np.float64]
OfLoad = Callable[[ArrayLike], FloatArray]
LARGEST_ELASTIC = 0.6  # plasticity index up to which contact is elastic (Greenwood and Williamson)


@dataclass(frozen=True, slots=True)
class TheoryCurve:
    """One law against the load P (N, any shape).

    Attributes
    ----------
    name, equation
        Its name, and where it stands in the paper.
    stiffness
        k_c, N/m.
    separation
        Separation of the mean planes, m; of smooth bodies, minus the approach. None where the law has none.
    contact_area
        Area that really touches, m2; None where the law has none.
    unloads_alike
        Whether small unloading is as stiff as loading: asperities are elastic, or the curve is that of unloading. A
        ring-down, or ultrasound, sees unloading; load against approach shows loading.
    """

    name: str
    equation: str
    stiffness: OfLoad
    separation: OfLoad | None = None
    contact_area: OfLoad | None = None
    unloads_alike: bool = True


@dataclass(frozen=True, slots=True)
class Surfaces:
    """A contact in SI units: what the theories take.

    Attributes
    ----------
    E_star
        Composite modulus, Pa.
    eta, R_s, R_q
        Asperities per area, 1/m2; their radius and the rms roughness of both surfaces together, m.
    H, nu
        Hardness, Pa, and Poisson's ratio of the softer body.
    R, A_n
        Radius of the sphere, m, or nominal area of the flats, m2; None for the other kind.
    """

    E_star: float
    eta: float
    R_s: float
    R_q: float
    H: float
    nu: float
    R: float | None = None
    A_n: float | None = None


def surfaces_of(contact: Literal["paper-flat", "paper-sphere"] | SphereContact | FlatContact) -> Surfaces:
    """Return a contact of the configuration, or a preset, in SI units."""
    given = resolve(contact)
    upper, lower = given.upper, given.lower
    softer = min(upper, lower, key=lambda body: body.hardness_gpa)
    return Surfaces(
        E_star=composite_modulus(
            upper.youngs_modulus_gpa * 1e9, upper.poisson_ratio, lower.youngs_modulus_gpa * 1e9, lower.poisson_ratio
        ),
        eta=given.asperity_density_per_um2 * 1e12,
        R_s=given.asperity_radius_um * 1e-6,
        R_q=given.roughness_rq_um * 1e-6,
        H=softer.hardness_gpa * 1e9,
        nu=softer.poisson_ratio,
        R=given.radius_um * 1e-6 if isinstance(given, SphereContact) else None,
        A_n=given.nominal_area_mm2 * 1e-6 if isinstance(given, FlatContact) else None,
    )


def theory(contact: Literal["paper-flat", "paper-sphere"] | SphereContact | FlatContact) -> list[TheoryCurve]:
    """Return the theoretical curves for a contact.

    Sphere on flat: Hertz smooth (Eq. 2), a third of it (Eq. 3), and the rough sphere solved at every load. Flats:
    exponential asperity heights (Eq. 7, 8), Gaussian ones (Eq. 5), and Gaussian ones that yield: their first loading
    (Eq. 6), and their elastic unloading, which is what a ring-down sees of them.
    """
    s = surfaces_of(contact)
    return _flats(s, s.A_n) if s.A_n is not None else _sphere(s, float(s.R or np.nan))


def _sphere(s: Surfaces, R: float) -> list[TheoryCurve]:
    rough = RoughSphere(R, s.E_star, s.eta, s.R_s, s.R_q)
    return [
        TheoryCurve(
            "Hertz, smooth",
            "Eq. 2",
            partial(hertz.stiffness, R=R, E_star=s.E_star),
            lambda P: -hertz.approach(P, R, s.E_star),
            partial(hertz.contact_area, R=R, E_star=s.E_star),
        ),
        TheoryCurve("Hertz, rough at light load", "Eq. 3", partial(hertz.rough_stiffness, R=R, E_star=s.E_star)),
        TheoryCurve("rough sphere", "Greenwood and Tripp", rough.stiffness, rough.separation, rough.contact_area),
    ]


def _flats(s: Surfaces, A_n: float) -> list[TheoryCurve]:
    asperities = {"eta": s.eta, "A_n": A_n, "E_star": s.E_star, "R_s": s.R_s, "R_q": s.R_q}
    yielding = ElasticPlasticFlats(H=s.H, nu=s.nu, **asperities)
    return [
        TheoryCurve(
            "rough flats, exponential heights",
            "Eq. 7, 8",
            partial(exponential.stiffness, R_q=s.R_q),
            partial(exponential.separation, **asperities),
            partial(exponential.contact_area, **asperities),
        ),
        TheoryCurve(
            "rough flats, Gaussian heights",
            "Eq. 5",
            partial(gaussian.stiffness, **asperities),
            partial(gaussian.separation, **asperities),
            partial(gaussian.contact_area, **asperities),
        ),
        TheoryCurve(
            "rough flats, Gaussian heights that yield",
            "Eq. 6",
            yielding.stiffness,
            yielding.separation,
            yielding.contact_area,
            unloads_alike=False,
        ),
        TheoryCurve(
            "yielded rough flats, unloading",
            "spots of Eq. 6",
            yielding.unloading_stiffness,
            contact_area=yielding.contact_area,
        ),
    ]


@dataclass(frozen=True, slots=True)
class Plasticity:
    """How far a contact's asperities yield.

    Attributes
    ----------
    index
        CEB's plasticity index: below 0.6 elastic, above 1 plastic at any load.
    critical_interference
        Of an asperity that begins to yield, m.
    yielded_share
        Share of the load carried by yielded asperities at each of some loads, (n,); None for a sphere.
    """

    index: float
    critical_interference: float
    yielded_share: FloatArray | None

    def sentence(self, load: FloatArray) -> str:
        """Say what this means for a ring-down at the loads (n,), N."""
        if self.index < LARGEST_ELASTIC:
            return f"The plasticity index is {self.index:.2g}: asperities stay elastic, and loading is unloading."
        said = (
            f"The plasticity index is {self.index:.2g}: asperities yield from {self.critical_interference * 1e9:.2g} nm"
        )
        if self.yielded_share is not None and len(load):
            said += f", and those that have yielded carry {100 * self.yielded_share.min():.4g} % of the load or more"
        return f"{said}. A ring-down sees their elastic unloading, which is stiffer than the slope of first loading."


def plasticity(
    contact: Literal["paper-flat", "paper-sphere"] | SphereContact | FlatContact, load: ArrayLike
) -> Plasticity:
    """Return how far the asperities of a contact yield at loads, N."""
    s = surfaces_of(contact)
    flats = ElasticPlasticFlats(s.eta, s.A_n or 1.0, s.E_star, s.R_s, s.R_q, s.H, s.nu)
    share = None if s.A_n is None else flats.yielded_share(load)
    return Plasticity(flats.plasticity_index, flats.critical_interference * s.R_q, share)
