"""The uncertainty budgets of a load: P, f1, f2, zeta1, zeta2, k_c and c_c, each source with its share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.stiffness import ContactEstimate
from analysis.tap_scatter import Repeated
from calibration.budget import Budget, Contribution
from calibration.estimate import Estimate
from rig.settings import Wiring

FloatArray = NDArray[np.float64]
UNITS = {"f1_hz": "Hz", "f2_hz": "Hz", "zeta1": "1", "zeta2": "1"}
PPM = 1e-6


@dataclass(frozen=True, slots=True)
class RigSource:
    """One independent source of uncertainty of masses and springs.

    Attributes
    ----------
    source, value, unit, standard_uncertainty
        What it is.
    effect
        (4,) derivatives of m1, m2 (kg), k1, k2 (N/m) by it.
    dof
        Degrees of freedom of its standard uncertainty.
    """

    source: str
    value: float
    unit: str
    standard_uncertainty: float
    effect: FloatArray
    dof: float = math.inf


def rig_covariance(sources: tuple[RigSource, ...]) -> FloatArray:
    """(4, 4) covariance of m1, m2, k1, k2 that independent sources make."""
    columns = np.array([s.standard_uncertainty * s.effect for s in sources])
    return np.asarray(columns.T @ columns, dtype=np.float64)


def mass_sources(
    masses: tuple[float, float], covariance: FloatArray, springs_by_mass: FloatArray | None
) -> list[RigSource]:
    """Sources of the masses: what each is uncertain by itself, and what both are together.

    ``covariance`` is their (2, 2); ``springs_by_mass`` (2, 2) what springs measured through the system mode follow
    them by, or None.
    """
    follow = np.zeros((2, 2)) if springs_by_mass is None else springs_by_mass
    common = max(float(covariance[0, 1]), 0.0)
    sources = []
    for i, value in enumerate(masses):
        own = max(float(covariance[i, i]) - common, 0.0)
        effect = np.concatenate([np.eye(2)[i], follow[:, i]])
        sources.append(RigSource(f"mass m{i + 1}", value, "kg", math.sqrt(own), effect))
    if common > 0:
        both = np.concatenate([np.ones(2), follow.sum(axis=1)])
        sources.append(RigSource("what both masses have in common", math.nan, "kg", math.sqrt(common), both))
    return sources


def modal_budget(name: str, found: Repeated, wiring: Wiring) -> Budget:
    """Budget of a frequency or damping ratio of a load."""
    unit, value = UNITS[name], found.estimate.value
    parts = [_repeatability(found, unit)]
    if unit == "Hz":
        parts.append(_clock(wiring, value))
    parts.append(_accelerometers(wiring))
    return Budget(name, unit, value, tuple(parts))


def contact_budgets(
    found: Mapping[str, Repeated],
    plain: ContactEstimate,
    corrected: ContactEstimate,
    sources: tuple[RigSource, ...],
    springs_by_clock: tuple[float, float],
    wiring: Wiring,
    tube_share_unsure: float,
) -> tuple[Budget, Budget]:
    """Budgets of k_c and c_c of a load.

    Parameters
    ----------
    found
        Taps of ``f2_hz`` and ``zeta2``.
    plain, corrected
        By Eq. 10, and with the dampers beside the tube springs taken off.
    sources
        Of masses and springs.
    springs_by_clock
        Derivatives of k1 and k2 by the relative error of the recorder's clock.
    tube_share_unsure
        Standard uncertainty of what was taken off, relative.
    """
    f2, zeta2 = found["f2_hz"], found["zeta2"]
    budgets = []
    for row, (quantity, unit) in enumerate(
        (("contact_stiffness_n_per_m", "N/m"), ("contact_damping_n_s_per_m", "N s/m"))
    ):
        gradient = plain.gradient[row]
        by_clock = gradient[0] * f2.estimate.value + float(gradient[4:] @ np.array(springs_by_clock))
        before, after = (_values(estimate)[row] for estimate in (plain, corrected))
        parts = [
            replace(_repeatability(f2, "Hz", "f2: "), sensitivity=float(gradient[0])),
            replace(_repeatability(zeta2, "1", "zeta2: "), sensitivity=float(gradient[1])),
            *(
                Contribution(s.source, s.value, s.unit, s.standard_uncertainty, float(gradient[2:] @ s.effect), s.dof)
                for s in sources
            ),
            _clock(wiring, by_clock),
            _accelerometers(wiring),
        ]
        if after != before:
            taken = before - after
            parts.append(
                Contribution("damping of the tube springs, taken off", taken, unit, tube_share_unsure * abs(taken), 1.0)
            )
        budgets.append(Budget(quantity, unit, after, tuple(parts)))
    return budgets[0], budgets[1]


def with_clock(estimate: Estimate, wiring: Wiring) -> Estimate:
    """Return a frequency with the uncertainty of the recorder's clock."""
    own = Contribution("", estimate.value, "Hz", estimate.standard_error, 1.0, estimate.dof)
    return Budget("", "Hz", estimate.value, (own, _clock(wiring, estimate.value))).estimate()


def _values(contact: ContactEstimate) -> tuple[float, float]:
    return contact.stiffness_n_per_m.value, contact.damping_n_s_per_m.value


def _repeatability(found: Repeated, unit: str, of: str = "") -> Contribution:
    estimate = found.estimate
    if found.scatter is not None:
        source = f"{of}noise of one tap, and scatter from {found.scatter.source}"
    elif math.isinf(estimate.dof):
        source = f"{of}noise of {found.taps} taps, which scatter no more than that"
    else:
        share = min(100 * (found.noise / max(estimate.standard_error, 1e-300)) ** 2, 100.0)
        source = f"{of}scatter of {found.taps} taps, of its variance {share:.0f} % noise"
    return Contribution(source, estimate.value, unit, estimate.standard_error, 1.0, estimate.dof, "t")


def _clock(wiring: Wiring, sensitivity: float) -> Contribution:
    return Contribution(
        "clock of the recorder",
        math.nan,
        "1",
        wiring.clock_accuracy_ppm * PPM / math.sqrt(3),
        sensitivity,
        distribution="rectangular",
    )


def _accelerometers(wiring: Wiring) -> Contribution:
    """Sensitivity scales all samples alike: poles, and what follows from them, do not change."""
    worst = max(c.sensitivity_uncertainty_percent for c in (wiring.accelerometer_a, wiring.accelerometer_b))
    return Contribution("sensitivity of the accelerometers", math.nan, "1", worst / 100, 0.0)
