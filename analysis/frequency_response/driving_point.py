"""Both masses of Eq. 9 and k_c, from a hammer's force, the struck mass's own acceleration and the other one's."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from analysis.frequency_response.cross_check import first_model, fitted_band
from analysis.frequency_response.impacts import Measured
from analysis.frequency_response.two_mass import LOWER, UPPER, Seen, TwoMassFit, fit_two_mass
from analysis.moving_masses import MovingMasses
from calibration.estimate import Estimate
from daq.records import RigDescription

TRIED = 0.1
"""Relative difference of k1 and k2 by which it is found what their unknown ratio does to all else; nearly linear."""


@dataclass(frozen=True, slots=True)
class DrivingPoint:
    """Eq. 9 by both responses; intervals with the springs' unknown ratio, and what a difference of `TRIED` changes.

    The changes, relative, are those of the struck mass, of the other one and of k_c.
    """

    fit: TwoMassFit
    changes: tuple[float, float, float]


def two_masses(
    measured: Measured,
    rig: RigDescription,
    moving: MovingMasses,
    driving: int,
    other: int,
    scale_error: float = 0.0,
    split_error: float = 0.0,
) -> DrivingPoint:
    """Fit Eq. 9 to the driving-point and the transfer response together, which tell the masses apart.

    Parameters
    ----------
    measured
        Transforms of the hits, and their responses in m/s2 per N.
    rig, moving
        Where the fit begins: springs, and masses; "upper" is the mass that is struck.
    driving, other
        Rows of the struck mass's acceleration and of the other one's.
    scale_error
        Relative standard uncertainty of response over force.
    split_error
        Relative standard uncertainty of how the springs' sum splits, as `AnalysisSettings.spring_asymmetry_percent`.

    Raises
    ------
    ForceError
        The contact mode is not excited, or no model is anywhere near.
    """
    response = measured.response
    frequency = response.frequency_hz
    band = fitted_band(response, rig, moving, 2 * float(frequency[-1]))
    start = first_model(frequency, response.h1[other], response.decay_per_s, rig, moving, band)
    seen = [Seen(driving, UPPER), Seen(other, LOWER)]
    common = measured.spectra, frequency, seen
    fit = fit_two_mass(*common, start, band, response.decay_per_s, scale_error)
    unlike = replace(start, k1=start.k1 * (1 + TRIED / 2), k2=start.k2 * (1 - TRIED / 2))
    other_fit = fit_two_mass(*common, unlike, band, response.decay_per_s, scale_error)
    share = split_error * math.sqrt(2) / TRIED  # each spring by split_error / sqrt(2), where TRIED moves it by half
    names = ("upper_mass", "lower_mass", "contact_stiffness", "contact_damping", "mass_sum", "spring_sum")
    moved = {name: _value(other_fit, name) - _value(fit, name) for name in names}
    widened = {name: _with(getattr(fit, name), share * moved[name]) for name in names}
    changes = (moved[name] / _value(fit, name) for name in names[:3])
    return DrivingPoint(replace(fit, **widened), tuple(changes))  # type: ignore[arg-type]


def _value(fit: TwoMassFit, name: str) -> float:
    return float(getattr(fit, name).value)


def _with(estimate: Estimate, known: float) -> Estimate:
    """Return an estimate with one more, known uncertainty; degrees of freedom by Welch and Satterthwaite."""
    total = math.hypot(estimate.standard_error, known)
    before = estimate.standard_error
    return replace(estimate, standard_error=total, dof=estimate.dof * (total / before) ** 4 if before else math.inf)
