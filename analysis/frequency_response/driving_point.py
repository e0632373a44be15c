"""Both masses of Eq. 9 and k_c, from a hammer's force, the struck mass's own acceleration and the other one's."""

from __future__ import annotations

from analysis.frequency_response.cross_check import first_model, fitted_band
from analysis.frequency_response.impacts import Measured
from analysis.frequency_response.two_mass import LOWER, UPPER, Seen, TwoMassFit, fit_two_mass
from analysis.moving_masses import MovingMasses
from daq.records import RigDescription


def two_masses(
    measured: Measured, rig: RigDescription, moving: MovingMasses, driving: int, other: int, scale_error: float = 0.0
) -> TwoMassFit:
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
    return fit_two_mass(measured.spectra, frequency, seen, start, band, response.decay_per_s, scale_error)
