"""What stands between a theory of contact and a measurement, and what is known of it beforehand.

Each change makes another law of the load out of a law k_c(P), with one unknown number. `Priors` holds the ranges of
these numbers before anything was measured, twice: as they were first chosen, and reviewed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.contact.swing import apparent_share
from analysis.contact.weighing import Candidate, Parameter, Prediction, tolerance

FloatArray = NDArray[np.float64]
Number = FloatArray | float
Law = Callable[[FloatArray], FloatArray]  # k_c, N/m, of loads, N

LARGEST_SWING = 1.06  # N: the contact force at 1 g (Sec. 3.3) in the contact mode of the published masses
MASS_G = 107.5  # of a block of the tester, g: what a moving mass that was left out counts against
FRACTAL = (0.51, 0.77)  # exponents of elastic fractal surfaces, dimension 2 to 3 (Pohrt and Popov 2012)


@dataclass(frozen=True, slots=True)
class Priors:
    """Ranges of the unknown numbers before anything was measured.

    Attributes
    ----------
    series, hardness, share, adhesion, carried, swing, roughness, density, mass, exponent
        Spring in series; hardness of asperities; share of the nominal area that meets; load that asperities carry
        beside the one read, and load read that they do not carry; swing of the contact force; R_q and asperity
        density over measured; mass left out of each block; exponent of any power law.
    of_flats, of_sphere
        What the scans say of R_q of the contact itself.
    coefficient
        Range of a power law at 0.5 N: MN/m, or over theory where ``by_theory``.
    """

    series: Parameter
    hardness: Parameter
    share: Parameter
    adhesion: Parameter
    carried: Parameter
    swing: Parameter
    roughness: Parameter
    density: Parameter
    mass: Parameter
    exponent: Parameter
    of_flats: Parameter
    of_sphere: Parameter
    coefficient: tuple[float, float]
    by_theory: bool

    def power_law(self, theory_mn_per_m: float) -> Parameter:
        """Return the coefficient of a power law, for a theory that gives so much at 0.5 N."""
        unit = theory_mn_per_m if self.by_theory else 1.0
        low, high = self.coefficient
        return Parameter("k_c at 0.5 N", "MN/m", low * unit, high * unit)


WIDE = Priors(
    series=Parameter("k_s", "MN/m", 0.3, 1000.0),
    hardness=Parameter("H", "GPa", 0.3, 30.0),
    share=Parameter("share of A_n", "", 1e-4, 1.0),
    adhesion=Parameter("P_a", "N", 0.0, 0.5, logarithmic=False),
    carried=Parameter("P_0", "N", 0.0, 0.5, logarithmic=False),
    swing=Parameter("F", "N", 0.0, LARGEST_SWING, logarithmic=False),
    roughness=Parameter("R_q over measured", "", 0.2, 5.0),
    density=Parameter("asperity density over assumed", "", 0.1, 10.0),
    mass=Parameter("mass left out", "g", 0.0, 20.0, logarithmic=False),
    exponent=Parameter("exponent", "", 0.0, 1.5, logarithmic=False),
    of_flats=tolerance("R_q over measured", 0.10),
    of_sphere=tolerance("R_q over measured", 0.15),
    coefficient=(0.01, 1000.0),
    by_theory=False,
)
"""As first chosen: two to five decades wherever nothing was known, which makes what has them pay for the width."""

REVIEWED = Priors(
    # softer than 1 MN/m nothing could measure 1.8 MN/m through it, stiffer than 300 it takes 3 % off the stiffest point
    series=Parameter("k_s", "MN/m", 1.0, 300.0),
    # 2.96 GPa is stated; at the scale of asperities steels are up to three times as hard as a large indent says
    hardness=Parameter("H", "GPa", 1.5, 9.0),
    # less than a hundredth of the area, 0.15 mm across, would be an edge and no flat
    share=Parameter("share of A_n", "", 0.01, 1.0),
    # zero of a gauge that is calibrated before and after, and pulls of menisci: a tenth of the range
    adhesion=Parameter("P_a", "N", 0.0, 0.1, logarithmic=False),
    carried=Parameter("P_0", "N", 0.0, 0.1, logarithmic=False),
    swing=Parameter("F", "N", 0.0, LARGEST_SWING, logarithmic=False),
    # two samples of one batch; a factor of three is a different finish
    roughness=Parameter("R_q over measured", "", 1 / 3, 3.0),
    density=Parameter("asperity density over assumed", "", 0.1, 10.0),
    # tubes 2.7 g, screws, cables, whatever a balance did not see
    mass=Parameter("mass left out", "g", 0.0, 20.0, logarithmic=False),
    exponent=Parameter("exponent", "", 0.0, 1.0, logarithmic=False),
    # scans of 1 mm are as long as the flats are wide
    of_flats=tolerance("R_q over measured", 0.10),
    # the contact of the sphere is 15 to 36 um across (Hertz): of a scan of 1 mm it sees the short waves alone
    of_sphere=Parameter("R_q over measured", "", 0.2, 1.1),
    # a factor of ten either way from theory
    coefficient=(0.1, 10.0),
    by_theory=True,
)
"""What physics leaves of the ranges; each line says why."""


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


def with_mass_left_out(k_c: Law, mass_g: Number) -> Law:
    """Return k_c(P) as Eq. 11 has it from masses that are ``mass_g``, g each, too small.

    All of Eq. 10 is proportional to masses and stiffnesses together: the springs follow from f1 and the same masses.
    """
    return lambda P: k_c(P) / (1 + mass_g / MASS_G)


def series(priors: Priors) -> Change:
    """Return the spring in series."""
    statement = "a spring k_s in series: holder, set screws, adhesive, body of the samples"
    return Change("series_compliance", statement, priors.series, in_series)


def others(priors: Priors) -> tuple[Change, ...]:
    """Return the other changes."""
    return (
        Change(
            "adhesion",
            "the asperities carry P_a more than the load read: attraction, or the zero of the gauge",
            priors.adhesion,
            _shifted,
        ),
        Change("carried_load", "P_0 of the load read does not pass through the contact", priors.carried, _carried),
        Change(
            "amplitude",
            "vibration swings the contact force by F, and the resonance shows the softer mean",
            priors.swing,
            swinging,
        ),
        Change("moving_mass", "more mass moves than was declared, as of the tubes", priors.mass, with_mass_left_out),
    )


def changed(base: Callable[..., Law], own: Sequence[Parameter], changes: Sequence[Change]) -> Prediction:
    """y(P, own parameters, changes' parameters, roughness factor); changes act in their order."""

    def predict(P: FloatArray, *values: FloatArray) -> FloatArray:
        law = base(values[-1], *values[: len(own)])
        for change, value in zip(changes, values[len(own) : -1], strict=True):
            law = change.change(law, value)
        return law(P)

    return predict


def theory(name: str, statement: str, law: Callable[..., Law], uncertain: Parameter, *own: Parameter) -> Candidate:
    """Return a theory as it stands, with unknown numbers of its own."""
    return Candidate(name, statement, (*own, uncertain), changed(law, own, ()))


Pair = tuple[str, str, Callable[..., Law], Sequence[Parameter]]
"""Id, statement, law of (roughness factor, own parameters) and own parameters of a theory that gets a spring."""


def with_changes(
    name: str, base: Callable[..., Law], uncertain: Parameter, priors: Priors, pairs: Sequence[Pair]
) -> list[Candidate]:
    """A theory with each change, and with a spring in series beside each other one and each of ``pairs``."""
    spring = series(priors)
    found = []
    for change in (spring, *others(priors)):
        predict = changed(base, (), (change,))
        found.append(Candidate(change.id, f"{name}; {change.statement}", (change.parameter, uncertain), predict))
    for change in others(priors):
        predict = changed(base, (), (change, spring))
        found.append(
            Candidate(
                f"{change.id}+{spring.id}",
                f"{name}; {change.statement}; {spring.statement}",
                (change.parameter, spring.parameter, uncertain),
                predict,
            )
        )
    return [*found, *(with_change(*pair, spring, uncertain, priors) for pair in pairs)]


def with_change(
    name: str,
    statement: str,
    law: Callable[..., Law],
    own: Sequence[Parameter],
    change: Change,
    uncertain: Parameter,
    priors: Priors,
) -> Candidate:
    """Return a theory with unknown numbers of its own and a change; one whose R_q is unknown has no tolerance of it."""
    predict = changed(law, own, (change,))
    known = () if priors.roughness in own else (uncertain,)
    if not known:
        predict = _without_tolerance(predict)
    return Candidate(
        f"{name}+{change.id}", f"{statement}; {change.statement}", (*own, change.parameter, *known), predict
    )


def power_laws(priors: Priors, theory_mn_per_m: float) -> list[Candidate]:
    """Return a power of the load: any, that of fractal surfaces, and the latter on a spring.

    ``theory_mn_per_m`` is what theory gives at 0.5 N.
    """
    coefficient, spring = priors.power_law(theory_mn_per_m), series(priors)
    exponent = Parameter("exponent", "", *FRACTAL, logarithmic=False)
    said = "elastic fractal surfaces: a power of the load between 0.51 and 0.77"

    def law(P: FloatArray, c: FloatArray, e: FloatArray) -> FloatArray:
        return np.asarray(1e6 * c * (P / 0.5) ** e, dtype=np.float64)

    return [
        Candidate("power_law", "something else: any power of the load", (coefficient, priors.exponent), law),
        Candidate("fractal", said, (coefficient, exponent), law),
        Candidate(
            f"fractal+{spring.id}",
            f"{said}; {spring.statement}",
            (coefficient, exponent, spring.parameter),
            lambda P, c, e, k_s: in_series(lambda load: law(load, c, e), k_s)(P),
        ),
    ]


def _without_tolerance(predict: Prediction) -> Prediction:
    return lambda P, *values: predict(P, *values, np.ones((1, 1)))
